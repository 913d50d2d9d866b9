# SPDX-License-Identifier: MIT
"""The board of a hoverboard as one of the installed drive families."""

from typing import Final

from segway_ecc.firmware_io.drives.family import DriveFamily, DriveWatchdog, SettingsToCheck
from segway_ecc.firmware_io.drives.hoverboard.driver import Hoverboard
from segway_ecc.firmware_io.drives.hoverboard.frames import HoverboardCodec
from segway_ecc.firmware_io.drives.hoverboard.settings import HoverboardSettings
from segway_ecc.firmware_io.drives.hoverboard.stopper import HoverboardStopper

_SHORTER: Final = "build the firmware with #define SERIAL_TIMEOUT 8, and write hardware.serial_timeout_cycles: 8"


def _watchdog(settings: HoverboardSettings) -> DriveWatchdog:
    how = f"SERIAL_TIMEOUT {settings.serial_timeout_cycles} of its firmware, as the robot file has it"
    return DriveWatchdog(settings.timeout_s, how, _SHORTER)


def _to_check(settings: HoverboardSettings) -> SettingsToCheck:
    return SettingsToCheck(
        "hoverboard firmware",
        "what it was built with is not reported",
        "with the values of its config.h as they come, torque follows 50 ms late, and each command moves both motors",
        "build it with VARIANT_USART, TANK_STEERING, FOC_CTRL, TRQ_MODE, FILTER 65535, RATE 32767, "
        f"I_MOT_MAX {settings.max_current:g} and SERIAL_TIMEOUT {settings.serial_timeout_cycles}",
    )


FAMILY: Final[DriveFamily[HoverboardSettings]] = DriveFamily(
    settings=HoverboardSettings,
    drives=lambda settings, link, period_s, clock: [Hoverboard(link, settings, period_s, clock)],
    stopper=lambda _: HoverboardStopper(),
    watchdog=_watchdog,
    to_check=_to_check,
    serial_codec=HoverboardCodec,
    velocity_error=0.15,
    packet_pause_bytes=24,  # 2 ms: a USB adapter joins what comes in two of its frames
)
