# SPDX-License-Identifier: MIT
"""What the drives are set to by themselves: what their drivers read back of it, and what a person is to look up.

Read back is what a driver reports in the hardware's health. What no driver reads yet is looked up in the vendor's tool:
the names are those of odrivetool (docs.odriverobotics.com, 0.5.6 and 0.6), of VESC Tool 6, of moteus' console and of
CiA 402-2. A driver that reads more gets a line in `_readings` and loses one in the look-ups of its family.
"""

import math
import re
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.firmware_io.drives.moteus.settings import MoteusSettings
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.settings import HardwareSettings

_FIGURES: Final = {
    "watchdog_s": re.compile(r"^board\.watchdog_s=([\d.]+)$"),
    "{}_rated_torque_n_m": re.compile(r"^drives\.(\w+)\.rated_torque_nm=([\d.e+-]+)$"),
    "{}_least_current_a": re.compile(r"^(\w+)\.firmware=.*; motor (-?[\d.e+-]+) to "),
    "{}_most_current_a": re.compile(r"^(\w+)\.firmware=.*; motor \S+ to (\S+) A"),
}
"""By name with the axis and the unit: where the health of the hardware, as `key=text`, has it."""


class DriveLimits(NamedTuple):
    """What is known of the drives' own limits.

    Attributes:
        measured: What was read back, SI, by name with the unit.
        lookups: What was not: a line for each, with what to type in the vendor's tool and what it is to show.
    """

    measured: Mapping[str, float]
    lookups: tuple[str, ...]


def drive_limits(settings: HardwareSettings, health: Mapping[str, str], fastest_rad_s: float) -> DriveLimits:
    """What was read back of the drives' own limits, and what is to be looked up.

    Args:
        settings: Of the hardware, from the robot file.
        health: What it reports; see `Hardware.health`.
        fastest_rad_s: At which the robot file has a wheel end in a fault, rad/s.
    """
    measured = _readings(health)
    return DriveLimits(measured, tuple(_LOOKUPS[type(settings)](settings, measured, fastest_rad_s)))


def _readings(health: Mapping[str, str]) -> dict[str, float]:
    found = {}
    for key, text in health.items():
        for name, pattern in _FIGURES.items():
            match = pattern.match(f"{key}={text}")
            if match is not None:
                *axis, figure = match.groups()
                found[name.format(*axis)] = float(figure)
    return found


def _of_board(_settings: HardwareSettings, measured: Mapping[str, float], _fastest: float) -> list[str]:
    """A wheel board has no settings but its watchdog, which it reports."""
    return [] if "watchdog_s" in measured else ["see the watchdog of the wheel board, which does not report it"]


def _of_odrive(settings: HardwareSettings, _measured: Mapping[str, float], fastest_rad_s: float) -> list[str]:
    assert isinstance(settings, OdriveSettings)  # noqa: S101 - chosen by its type
    lines = []
    for side, wheel in settings.axes.items():
        torque, turns_s = abs(wheel.motor_torque(wheel.max_torque)), _turns(wheel.motor(fastest_rad_s))
        axis = f"odrv0.axis{wheel.axis}"
        amperes = (
            f"{torque:.4g} N m / torque_constant"
            if wheel.torque_constant is None
            else f"{torque / wheel.torque_constant:.4g} A"
        )
        if settings.firmware != "0.6":
            lines += [
                f"{side}, firmware 0.5: {axis}.motor.config.current_lim (at least {amperes})",
                f"{side}, firmware 0.5: {axis}.motor.config.torque_lim (at least {torque:.4g} N m)",
            ]
        if settings.firmware != "0.5":
            lines += [
                f"{side}, firmware 0.6: {axis}.config.motor.current_soft_max (at least {amperes})",
                f"{side}, firmware 0.6: {axis}.config.torque_soft_max (at least {torque:.4g} N m)",
            ]
        lines.append(f"{side}: {axis}.controller.config.vel_limit (at least {turns_s:.4g} turns/s)")
    return lines


def _of_vesc(settings: HardwareSettings, measured: Mapping[str, float], fastest_rad_s: float) -> list[str]:
    assert isinstance(settings, VescSettings)  # noqa: S101 - chosen by its type
    lines = []
    for side, wheel in settings.axes.items():
        who = f"{side} (id {wheel.controller_id})"
        if f"{side}_most_current_a" not in measured:
            lines.append(
                f"{who}: Motor Settings > General > Current: Motor Current Max and Motor Current Max Brake "
                f"(at least {wheel.max_current:.4g} A)"
            )
        rpm = 60.0 * _turns(wheel.motor(fastest_rad_s)) * wheel.pole_pairs
        lines.append(f"{who}: Motor Settings > General > RPM: Max ERPM (at least {rpm:.0f})")
    return lines


def _of_cia402(settings: HardwareSettings, measured: Mapping[str, float], fastest_rad_s: float) -> list[str]:
    assert isinstance(settings, Cia402Settings)  # noqa: S101 - chosen by its type
    lines = []
    for side, wheel in settings.axes.items():
        rated = measured.get(f"{side}_rated_torque_n_m", math.nan)
        share = 1e3 * abs(wheel.motor_torque(wheel.max_torque)) / rated if rated else math.nan
        rpm = 60.0 * _turns(wheel.motor(fastest_rad_s))
        lines += [
            f"{side} (node {wheel.node_id}): object 0x6072:00, max torque (at least {share:.0f} per mille of 0x6076)",
            f"{side} (node {wheel.node_id}): object 0x6073:00, max current, per mille of 0x6075 (what the motor bears)",
            f"{side} (node {wheel.node_id}): object 0x6080:00, max motor speed (at least {rpm:.0f} rpm)",
        ]
    return lines


def _of_moteus(settings: HardwareSettings, _measured: Mapping[str, float], fastest_rad_s: float) -> list[str]:
    assert isinstance(settings, MoteusSettings)  # noqa: S101 - chosen by its type
    lines = []
    for name, axis in settings.axes.items():
        torque, turns_s = abs(axis.motor_torque(axis.max_torque)), _turns(axis.motor(fastest_rad_s))
        who = f"{name} (id {axis.servo_id})"
        lines += [
            f"{who}: conf get servo.max_current_A (at least {torque:.4g} N m / torque constant, 8.27 / motor.Kv)",
            f"{who}: conf get servo.max_velocity (at least {turns_s:.4g} turns/s)",
        ]
    return lines


def _turns(rad_s: float) -> float:
    """Turns a second, without the sign."""
    return abs(rad_s) / (2.0 * math.pi)


_LOOKUPS: Final[dict[type, Callable[[HardwareSettings, Mapping[str, float], float], list[str]]]] = {
    WheelBoardSettings: _of_board,
    OdriveSettings: _of_odrive,
    VescSettings: _of_vesc,
    Cia402Settings: _of_cia402,
    MoteusSettings: _of_moteus,
}
"""By family: the lines of what is not read back."""
