# SPDX-License-Identifier: MIT
"""VESC controllers as one of the installed drive families.

Its parts are imported where one is made; see `DriveFamily`.
"""
# ruff: noqa: PLC0415 - see above

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import Drive
from segway_ecc.firmware_io.drives.family import DriveFamily, DriveWatchdog
from segway_ecc.firmware_io.drives.stopper import Stopper
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.links.link import Link

if TYPE_CHECKING:
    from segway_ecc.firmware_io.links.serial_link import SerialCodec


def _drives(settings: VescSettings, link: Link, period_s: float, clock: Clock) -> Sequence[Drive]:
    from segway_ecc.firmware_io.drives.vesc.driver import Vesc

    return [Vesc(link, name, settings, period_s, clock.now_ns) for name in settings.axes]


def _stopper(settings: VescSettings) -> Stopper:
    from segway_ecc.firmware_io.drives.vesc.stopper import VescStopper

    return VescStopper(settings)


def _serial_codec(settings: VescSettings) -> "SerialCodec":
    from segway_ecc.firmware_io.drives.vesc.serial_codec import VescSerialCodec

    return VescSerialCodec(settings)


def _watchdog(settings: VescSettings) -> DriveWatchdog:
    return DriveWatchdog(settings.timeout_set_s, "set with VESC Tool; the node measures it before it arms")


FAMILY: Final = DriveFamily(
    settings=VescSettings,
    drives=_drives,
    stopper=_stopper,
    watchdog=_watchdog,
    serial_codec=_serial_codec,
)
