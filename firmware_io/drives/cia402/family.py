# SPDX-License-Identifier: MIT
"""CiA 402 drives as one of the installed drive families.

Its parts are imported where one is made; see `DriveFamily`.
"""
# ruff: noqa: PLC0415 - see above

from collections.abc import Sequence
from typing import Final

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import Drive
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.firmware_io.drives.family import DriveFamily, DriveWatchdog
from segway_ecc.firmware_io.drives.stopper import Stopper
from segway_ecc.firmware_io.links.link import Link


def _drives(settings: Cia402Settings, link: Link, period_s: float, clock: Clock) -> Sequence[Drive]:
    from segway_ecc.firmware_io.drives.cia402.driver import Cia402Drives

    return [Cia402Drives(link, settings, period_s, clock.now_ns, clock.sleep_until_ns)]


def _stopper(settings: Cia402Settings) -> Stopper:
    from segway_ecc.firmware_io.drives.cia402.stopper import Cia402Stopper

    return Cia402Stopper(settings)


def _watchdog(settings: Cia402Settings) -> DriveWatchdog:
    return DriveWatchdog(settings.watchdog_s, "a heartbeat time that the node sets, and reads back before it arms")


FAMILY: Final = DriveFamily(
    settings=Cia402Settings,
    drives=_drives,
    stopper=_stopper,
    watchdog=_watchdog,
)
