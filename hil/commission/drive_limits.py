# SPDX-License-Identifier: MIT
"""What the drives are set to by themselves: what their drivers read back of it, and what a person is to look up.

What a driver reads back it compares with the robot file by itself, and refuses to arm. What no line allows to read is
looked up in the vendor's tool. Sources of the names: `Firmware/odrive-interface.yaml` and CHANGELOG.md of
github.com/odriverobotics/ODrive for odrivetool with 0.5, a list of endpoints of 0.6 for 0.6, the parameter names of
VESC Tool (`l_current_max`, `l_current_min`, `l_max_erpm`), of moteus' console and of CiA 402-2.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.firmware_io.drives.family import family_of
from segway_ecc.firmware_io.drives.moteus.settings import MoteusSettings
from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.firmware_io.drives.odrive.setting_names import PATHS, OwnSetting
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings, OdriveWheelSettings
from segway_ecc.firmware_io.drives.readings import DriveReading
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.settings import HardwareSettings


class DriveLimits(NamedTuple):
    """What is known of the drives' own limits.

    Attributes:
        measured: What was read back, by name with the unit.
        lookups: What was not: a line for each, with what to type in the vendor's tool and what it is to show.
    """

    measured: Mapping[str, float]
    lookups: tuple[str, ...]


def drive_limits(settings: HardwareSettings, readings: Sequence[DriveReading], fastest_rad_s: float) -> DriveLimits:
    """What was read back of the drives' own limits, and what is to be looked up.

    Args:
        settings: Of the hardware, from the robot file.
        readings: What its drives have read back.
        fastest_rad_s: At which the robot file has a wheel end in a fault, rad/s.
    """
    measured = {reading.name: reading.value for reading in readings}
    lookups = _LOOKUPS.get(type(settings), _of_any)(settings, measured, fastest_rad_s)
    return DriveLimits(measured, tuple(lookups))


def _of_any(settings: HardwareSettings, _measured: Mapping[str, float], _fastest: float) -> list[str]:
    """What another family says of itself that a person has to look at."""
    family = family_of(settings)
    to_check = None if family.to_check is None else family.to_check(settings)
    return [] if to_check is None else [to_check.remedy]


def _of_board(_settings: HardwareSettings, measured: Mapping[str, float], _fastest: float) -> list[str]:
    """A wheel board has no settings but its watchdog, which it reports."""
    return [] if "watchdog_s" in measured else ["see the watchdog of the wheel board, which does not report it"]


def _of_odrive(settings: HardwareSettings, measured: Mapping[str, float], fastest_rad_s: float) -> list[str]:
    assert isinstance(settings, OdriveSettings)  # noqa: S101 - chosen by its type
    lines = []
    firmwares = list(Firmware) if settings.firmware == "auto" else [Firmware(settings.firmware)]
    for side, wheel in settings.axes.items():
        read = {setting for setting in OwnSetting if any(name.startswith(f"{side}_{setting}") for name in measured)}
        lines += [
            f"{side}, firmware {firmware}: odrv0.{path.format(wheel.axis if firmware is Firmware.V0_5 else 0)} ({want})"
            for setting, want in _odrive_wants(wheel, fastest_rad_s)
            for firmware in firmwares
            if setting not in read and (path := PATHS[firmware].get(setting)) is not None
        ]
    return lines


def _odrive_wants(wheel: OdriveWheelSettings, fastest_rad_s: float) -> list[tuple[OwnSetting, str]]:
    """What each setting is to show."""
    torque, turns_s = abs(wheel.motor_torque(wheel.max_torque)), _turns(wheel.motor(fastest_rad_s))
    amperes = (
        f"{torque:.4g} N m / torque_constant"
        if wheel.torque_constant is None
        else f"{torque / wheel.torque_constant:.4g} A"
    )
    return [
        (OwnSetting.CURRENT_LIMIT, f"at least {amperes}"),
        (OwnSetting.TORQUE_LIMIT, f"at least {torque:.4g} N m"),
        (OwnSetting.VELOCITY_LIMIT, f"at least {turns_s:.4g} turns/s"),
        (OwnSetting.NEGATIVE_CURRENT, "what the battery takes while the robot brakes, A, negative"),
    ]


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
        rpm, who = 60.0 * _turns(wheel.motor(fastest_rad_s)), f"{side} (node {wheel.node_id})"
        if f"{side}_max_torque_n_m" not in measured:
            lines.append(f"{who}: object 0x6072:00, max torque (at least {share:.0f} per mille of 0x6076)")
        lines.append(f"{who}: object 0x6073:00, max current, per mille of 0x6075 (what the motor bears)")
        if not measured.get(f"{side}_max_speed_rpm", 0.0) >= rpm:
            lines.append(f"{who}: object 0x6080:00, max motor speed (at least {rpm:.0f} rpm)")
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
