# SPDX-License-Identifier: MIT
"""moteus controllers as an installed drive family; its parts are imported where one is made, see `DriveFamily`."""
# ruff: noqa: PLC0415 - see above

from collections.abc import Sequence
from typing import Final

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import Drive
from segway_ecc.firmware_io.drives.family import DriveFamily, DriveWatchdog
from segway_ecc.firmware_io.drives.moteus.settings import MoteusSettings
from segway_ecc.firmware_io.drives.stopper import Stopper
from segway_ecc.firmware_io.links.link import Link


def _drives(settings: MoteusSettings, link: Link, period_s: float, clock: Clock) -> Sequence[Drive]:
    from segway_ecc.firmware_io.drives.moteus.driver import Moteus

    return [Moteus(link, name, settings, period_s, clock.now_ns) for name in settings.axes]


def _stopper(settings: MoteusSettings) -> Stopper:
    from segway_ecc.firmware_io.drives.moteus.stopper import MoteusStopper

    return MoteusStopper(settings)


FAMILY: Final = DriveFamily(
    settings=MoteusSettings,
    drives=_drives,
    stopper=_stopper,
    watchdog=lambda settings: DriveWatchdog(settings.watchdog_s, "sent in each command, and read back before arming"),
)
