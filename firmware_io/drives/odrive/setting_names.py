# SPDX-License-Identifier: MIT
"""The settings of an axis and its board that are compared with the robot file, and their names.

Names: `Firmware/odrive-interface.yaml` and the changelog of github.com/odriverobotics/ODrive for 0.5.1 to 0.5.6, and
for 0.6 those in a list of endpoints of that firmware.
"""

import enum
from collections.abc import Mapping
from typing import Final

from segway_ecc.firmware_io.drives.odrive.frames import Firmware


@enum.unique
class OwnSetting(enum.StrEnum):
    """A setting of an axis or of its board; the value names it in reports."""

    VELOCITY_LIMIT = "vel_limit"
    OVERSPEED_ERROR = "enable_overspeed_error"
    TORQUE_MODE_LIMIT = "enable_torque_mode_vel_limit"
    CURRENT_LIMIT = "current_limit"
    TORQUE_LIMIT = "torque_limit"
    WATCHDOG = "enable_watchdog"
    WATCHDOG_TIMEOUT = "watchdog_timeout"
    NEGATIVE_CURRENT = "dc_max_negative_current"
    BRAKE_RESISTOR = "enable_brake_resistor"


FLAGS: Final = frozenset(
    {
        OwnSetting.OVERSPEED_ERROR,
        OwnSetting.TORQUE_MODE_LIMIT,
        OwnSetting.WATCHDOG,
        OwnSetting.BRAKE_RESISTOR,
    }
)
"""Those that are on or off."""
OF_BOARD: Final = (OwnSetting.NEGATIVE_CURRENT, OwnSetting.BRAKE_RESISTOR)
"""Those that both axes of a board share."""
_BOTH: Final = {
    OwnSetting.VELOCITY_LIMIT: "axis{}.controller.config.vel_limit",
    OwnSetting.OVERSPEED_ERROR: "axis{}.controller.config.enable_overspeed_error",
    OwnSetting.TORQUE_MODE_LIMIT: "axis{}.controller.config.enable_torque_mode_vel_limit",
    OwnSetting.WATCHDOG: "axis{}.config.enable_watchdog",
    OwnSetting.WATCHDOG_TIMEOUT: "axis{}.config.watchdog_timeout",
    OwnSetting.NEGATIVE_CURRENT: "config.dc_max_negative_current",
}
PATHS: Final[Mapping[Firmware, Mapping[OwnSetting, str]]] = {
    Firmware.V0_5: {
        **_BOTH,
        OwnSetting.CURRENT_LIMIT: "axis{}.motor.config.current_lim",
        OwnSetting.TORQUE_LIMIT: "axis{}.motor.config.torque_lim",
        OwnSetting.BRAKE_RESISTOR: "config.enable_brake_resistor",
    },
    Firmware.V0_6: {
        **_BOTH,
        OwnSetting.CURRENT_LIMIT: "axis{}.config.motor.current_soft_max",
        OwnSetting.TORQUE_LIMIT: "axis{}.config.torque_soft_max",
        OwnSetting.BRAKE_RESISTOR: "config.brake_resistor0.enable",
    },
}
"""Where odrivetool has each, under the board and with the axis' number to be filled in."""
