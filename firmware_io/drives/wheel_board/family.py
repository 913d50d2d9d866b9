# SPDX-License-Identifier: MIT
"""The wheel board as one of the installed drive families.

Its parts are imported where one is made; see `DriveFamily`.
"""
# ruff: noqa: PLC0415 - see above

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import Drive
from segway_ecc.firmware_io.drives.family import DriveFamily, DriveWatchdog
from segway_ecc.firmware_io.drives.stopper import Stopper
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.link import Link

if TYPE_CHECKING:
    from segway_ecc.firmware_io.links.serial_link import SerialCodec


def _drives(settings: WheelBoardSettings, link: Link, period_s: float, clock: Clock) -> Sequence[Drive]:
    from segway_ecc.firmware_io.drives.wheel_board.driver import WheelBoard

    return [WheelBoard(link, settings, period_s, clock.now_ns)]


def _stopper(settings: WheelBoardSettings) -> Stopper:
    from segway_ecc.firmware_io.drives.wheel_board.stopper import SessionBoardStopper, WheelBoardStopper

    return WheelBoardStopper() if settings.protocol == 1 else SessionBoardStopper()


def _serial_codec(_settings: WheelBoardSettings) -> "SerialCodec":
    from segway_ecc.firmware_io.drives.wheel_board.serial_codec import BoardSerialCodec

    return BoardSerialCodec()


def _watchdog(settings: WheelBoardSettings) -> DriveWatchdog:
    return DriveWatchdog(settings.watchdog_s, "set by the node, and read back before it arms")


FAMILY: Final = DriveFamily(
    settings=WheelBoardSettings,
    drives=_drives,
    stopper=_stopper,
    watchdog=_watchdog,
    serial_codec=_serial_codec,
    wire_description=Path(__file__).with_name("wheel_board.dbc"),
)
