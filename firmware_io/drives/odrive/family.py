# SPDX-License-Identifier: MIT
"""ODrives as one of the installed drive families.

Its parts are imported where one is made; see `DriveFamily`.
"""
# ruff: noqa: PLC0415 - see above

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import Drive
from segway_ecc.firmware_io.drives.family import DriveFamily, DriveWatchdog, SettingsToCheck
from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.firmware_io.drives.odrive.setting_names import PATHS, OwnSetting
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.stopper import Stopper
from segway_ecc.firmware_io.links.link import Link

_TRAPS: Final = (OwnSetting.VELOCITY_LIMIT, OwnSetting.OVERSPEED_ERROR, OwnSetting.NEGATIVE_CURRENT)

if TYPE_CHECKING:
    from segway_ecc.firmware_io.links.serial_link import SerialCodec


def _drives(settings: OdriveSettings, link: Link, period_s: float, clock: Clock) -> Sequence[Drive]:
    from segway_ecc.firmware_io.drives.odrive.driver import Odrive

    return [Odrive(link, name, settings, period_s, clock.now_ns) for name in settings.axes]


def _stopper(settings: OdriveSettings) -> Stopper:
    from segway_ecc.firmware_io.drives.odrive.stopper import OdriveStopper

    return OdriveStopper(settings)


def _serial_codec(settings: OdriveSettings) -> "SerialCodec":
    from segway_ecc.firmware_io.drives.odrive.serial_codec import OdriveSerialCodec

    return OdriveSerialCodec(settings)


def _watchdog(settings: OdriveSettings) -> DriveWatchdog:
    return DriveWatchdog(settings.watchdog_s, "set with odrivetool; the node has each axis prove it before it arms")


def _to_check(settings: OdriveSettings) -> SettingsToCheck | None:
    """What disarms an ODrive as delivered at its first drive, where no line reads it back."""
    if settings.serial is not None:
        return None
    firmware = Firmware.V0_6 if settings.firmware == "0.6" else Firmware.V0_5
    read = frozenset() if settings.endpoints is None else settings.endpoints.ids.keys()
    axes = (0, 1) if settings.firmware == "0.5" else (0,)
    paths = [PATHS[firmware][setting] for setting in _TRAPS]
    asked = list(dict.fromkeys(path.format(axis) for path in paths for axis in axes))
    unread = [f"odrv0.{path}" for path in asked if path not in read]
    if not unread:
        return None
    return SettingsToCheck(
        "ODrive settings",
        "not read back: " + ", ".join(dict.fromkeys(path.rpartition(".")[2] for path in unread)),
        "as delivered, an axis disarms above 2.4 turn/s of the motor, and at the first braking with no brake resistor",
        f"type in odrivetool: {', '.join(unread)}; set vel_limit above the "
        "fastest that the motor turns and dc_max_negative_current to what the battery takes (such as -10), then "
        "odrv0.save_configuration(). With 0.6 the node reads them itself where the robot file has `endpoints`: "
        "python -P -m segway_ecc.firmware_io.drives.odrive.endpoints flat_endpoints.json prints that section",
    )


FAMILY: Final = DriveFamily(
    settings=OdriveSettings,
    drives=_drives,
    stopper=_stopper,
    watchdog=_watchdog,
    to_check=_to_check,
    serial_codec=_serial_codec,
)
