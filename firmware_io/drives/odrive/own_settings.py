# SPDX-License-Identifier: MIT
"""What an axis and its board are set to, where a line allows to read it, against what the robot needs.

What each one does when it is too small: see `causes`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.devices import TURN
from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.firmware_io.drives.odrive.setting_names import FLAGS, PATHS, OwnSetting
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.readings import DriveReading

_EQUAL: Final = 1e-3
"""Relative: what is read went through a float of 32 bits, or a text with six places."""
_MARGIN: Final = 1.1
"""What a command that is proposed allows beyond what is needed."""
_NO_BRAKING_A: Final = -0.1
"""Above this next to nothing may flow back to the supply; a new board is set to -0.01 A."""


_UNITS: Final[Mapping[OwnSetting, tuple[str, str]]] = {
    OwnSetting.VELOCITY_LIMIT: ("turns_s", "turns/s"),
    OwnSetting.CURRENT_LIMIT: ("a", "A"),
    OwnSetting.TORQUE_LIMIT: ("n_m", "N m"),
    OwnSetting.WATCHDOG_TIMEOUT: ("s", "s"),
    OwnSetting.NEGATIVE_CURRENT: ("a", "A"),
}
"""In a name, and for people."""


class OwnSettings:
    """The settings of one axis and its board as far as they were read, and what is wrong with them.

    Attributes:
        values: What was read, in the unit of the firmware; 1 and 0 for on and off.
        unread: What the drive does not have, or did not answer.
    """

    def __init__(self, name: str, settings: OdriveSettings) -> None:
        """Nothing has been read yet of the axis of the wheel called `name`."""
        self.values: dict[OwnSetting, float] = {}
        self.unread: set[OwnSetting] = set()
        self._name = name
        self._wheel = settings.axes[name]
        self._watchdog_s = settings.watchdog_s

    def take(self, setting: OwnSetting, value: float) -> None:
        """Take a value that the drive sent; NaN where it has no such setting."""
        if math.isnan(value):
            self.unread.add(setting)
            return
        self.unread.discard(setting)
        self.values[setting] = value

    def reset(self) -> None:
        """Forget everything: the drive may have been restarted, with other settings."""
        self.values.clear()
        self.unread.clear()

    def knows(self, settings: Sequence[OwnSetting]) -> bool:
        """Whether each of these was read, or cannot be."""
        return all(setting in self.values or setting in self.unread for setting in settings)

    @property
    def readings(self) -> Sequence[DriveReading]:
        """What was read, for reports."""
        found = []
        for setting, value in self.values.items():
            suffix, unit = _UNITS.get(setting, ("", ""))
            found.append(DriveReading("_".join(filter(None, (self._name, setting, suffix))), value, unit))
        return found

    def arming_failures(self, firmware: Firmware, who: str) -> list[str]:
        """Each setting that does not let the robot have what its file asks for: its value, and what to type."""
        return [
            f"{who}: {self.path(firmware, setting)} is {self._text(setting)}, {why}; type in odrivetool: "
            f"odrv0.{self.path(firmware, setting)} = {command}, odrv0.save_configuration()"
            for setting, why, command in self._wrong()
        ]

    def path(self, firmware: Firmware, setting: OwnSetting) -> str:
        """Where odrivetool has a setting, under the board; a drive of 0.6 has one axis."""
        axis = self._wheel.axis if firmware is Firmware.V0_5 else 0
        return PATHS[firmware][setting].format(axis)

    def _text(self, setting: OwnSetting) -> str:
        value = self.values[setting]
        if setting in FLAGS:
            return str(bool(value))
        return f"{value:g} {_UNITS[setting][1]}"

    def _wrong(self) -> list[tuple[OwnSetting, str, str]]:
        """Settings that do not fit, why, and the value to give them."""
        wheel, values = self._wheel, self.values
        torque = abs(wheel.motor_torque(wheel.max_torque))
        needs: list[tuple[OwnSetting, float, str]] = [(OwnSetting.TORQUE_LIMIT, torque, "max_torque")]
        if wheel.torque_constant is not None:
            needs.append((OwnSetting.CURRENT_LIMIT, torque / wheel.torque_constant, "max_torque"))
        # The limit of speed does something while one of the two that look at it is on.
        looks = (values.get(flag) != 0.0 for flag in (OwnSetting.OVERSPEED_ERROR, OwnSetting.TORQUE_MODE_LIMIT))
        if wheel.max_velocity is not None and any(looks):
            turns_s = abs(wheel.motor(wheel.max_velocity)) / TURN
            needs.append((OwnSetting.VELOCITY_LIMIT, turns_s, "max_velocity"))
        wrong = [
            (setting, f"{name} takes {needed:.4g} {_UNITS[setting][1]}", f"{_MARGIN * needed:.3g}")
            for setting, needed, name in needs
            if values.get(setting, math.inf) < needed * (1.0 - _EQUAL)
        ]
        if values.get(OwnSetting.WATCHDOG) == 0.0:
            wrong.append((OwnSetting.WATCHDOG, "so that a torque stands when its host dies", "True"))
        if not 0.0 < values.get(OwnSetting.WATCHDOG_TIMEOUT, self._watchdog_s) <= self._watchdog_s * (1.0 + _EQUAL):
            why = f"watchdog_s of the robot file is {self._watchdog_s:g} s"
            wrong.append((OwnSetting.WATCHDOG_TIMEOUT, why, f"{self._watchdog_s:g}"))
        is_braked = values.get(OwnSetting.BRAKE_RESISTOR) == 1.0
        if values.get(OwnSetting.NEGATIVE_CURRENT, -math.inf) > _NO_BRAKING_A and not is_braked:
            why = "which ends at the first braking where there is no brake resistor, with DC_BUS_OVER_REGEN_CURRENT"
            wrong.append((OwnSetting.NEGATIVE_CURRENT, why, "-10, or what the battery takes"))
        return wrong
