# SPDX-License-Identifier: MIT
"""What a drive is set to against what the robot file asks of it."""

import math
from collections.abc import Callable

import pytest

from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.firmware_io.drives.odrive.own_settings import OwnSettings
from segway_ecc.firmware_io.drives.odrive.setting_names import PATHS, OwnSetting
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings

Configure = Callable[..., OdriveSettings]
S = OwnSetting
WHEEL = {"node_id": 0, "axis": 0, "max_torque": 3.0, "torque_constant": 0.1, "max_velocity": 10.0 * math.tau}
FIT = {
    S.VELOCITY_LIMIT: 10.0,
    S.OVERSPEED_ERROR: 1.0,
    S.TORQUE_MODE_LIMIT: 1.0,
    S.CURRENT_LIMIT: 30.0,
    S.TORQUE_LIMIT: math.inf,
    S.WATCHDOG: 1.0,
    S.WATCHDOG_TIMEOUT: 0.05,
    S.NEGATIVE_CURRENT: -10.0,
    S.BRAKE_RESISTOR: 0.0,
}


def own(configure: Configure, **values: float) -> OwnSettings:
    settings = OwnSettings("left", configure(axes={"left": WHEEL, "right": {**WHEEL, "node_id": 1}}))
    for setting, value in (FIT | {OwnSetting[name]: value for name, value in values.items()}).items():
        settings.take(setting, value)
    return settings


def test_settings_that_fit_refuse_nothing_and_are_reported(configure: Configure) -> None:
    settings = own(configure)
    assert settings.knows(list(OwnSetting))
    assert settings.arming_failures(Firmware.V0_5, "left") == []
    readings = {reading.name: (reading.value, reading.unit) for reading in settings.readings}
    assert readings["left_vel_limit_turns_s"] == (10.0, "turns/s")
    assert readings["left_enable_overspeed_error"] == (1.0, "")
    assert readings["left_dc_max_negative_current_a"] == (-10.0, "A")
    assert len(readings) == len(OwnSetting)


def test_settings_that_are_not_known_refuse_nothing(configure: Configure) -> None:
    settings = OwnSettings("left", configure(axes={"left": WHEEL, "right": {**WHEEL, "node_id": 1}}))
    assert settings.arming_failures(Firmware.V0_5, "left") == []
    assert settings.readings == []
    assert not settings.knows([S.WATCHDOG])
    settings.take(S.WATCHDOG, math.nan)
    assert settings.knows([S.WATCHDOG])
    settings.take(S.WATCHDOG, 1.0)
    assert (settings.unread, settings.values) == (set(), {S.WATCHDOG: 1.0})
    settings.reset()
    assert not settings.knows([S.WATCHDOG])


@pytest.mark.parametrize(
    ("values", "firmware", "expected"),
    [
        (
            {"VELOCITY_LIMIT": 2.0},
            Firmware.V0_5,
            (
                "left: axis0.controller.config.vel_limit is 2 turns/s, max_velocity takes 10 turns/s; type in "
                "odrivetool: odrv0.axis0.controller.config.vel_limit = 11, odrv0.save_configuration()"
            ),
        ),
        ({"CURRENT_LIMIT": 10.0}, Firmware.V0_5, "axis0.motor.config.current_lim is 10 A, max_torque takes 30 A"),
        (
            {"CURRENT_LIMIT": 10.0},
            Firmware.V0_6,
            "odrv0.axis0.config.motor.current_soft_max = 33, odrv0.save_configuration()",
        ),
        ({"TORQUE_LIMIT": 2.9}, Firmware.V0_6, "axis0.config.torque_soft_max is 2.9 N m, max_torque takes 3 N m"),
        ({"WATCHDOG": 0.0}, Firmware.V0_5, "odrv0.axis0.config.enable_watchdog = True"),
        ({"WATCHDOG_TIMEOUT": 0.2}, Firmware.V0_5, "odrv0.axis0.config.watchdog_timeout = 0.05"),
        ({"WATCHDOG_TIMEOUT": 0.0}, Firmware.V0_5, "config.watchdog_timeout is 0 s"),
        ({"NEGATIVE_CURRENT": -0.01}, Firmware.V0_5, "odrv0.config.dc_max_negative_current = -10"),
    ],
)
def test_a_setting_that_does_not_fit_is_named_with_its_value_and_the_command(
    configure: Configure, values: dict[str, float], firmware: Firmware, expected: str
) -> None:
    (failure,) = own(configure, **values).arming_failures(firmware, "left")
    assert expected in failure


@pytest.mark.parametrize(
    "values",
    [
        {"VELOCITY_LIMIT": 2.0, "OVERSPEED_ERROR": 0.0, "TORQUE_MODE_LIMIT": 0.0},
        {"NEGATIVE_CURRENT": -0.01, "BRAKE_RESISTOR": 1.0},
        {"CURRENT_LIMIT": 29.999},
    ],
)
def test_what_has_no_effect_refuses_nothing(configure: Configure, values: dict[str, float]) -> None:
    assert own(configure, **values).arming_failures(Firmware.V0_5, "left") == []


@pytest.mark.parametrize("flag", ["OVERSPEED_ERROR", "TORQUE_MODE_LIMIT"])
def test_a_limit_of_speed_counts_while_one_of_the_two_looks_at_it(configure: Configure, flag: str) -> None:
    values = {"VELOCITY_LIMIT": 2.0, "OVERSPEED_ERROR": 0.0, "TORQUE_MODE_LIMIT": 0.0, flag: 1.0}
    assert len(own(configure, **values).arming_failures(Firmware.V0_5, "left")) == 1


def test_what_the_robot_file_does_not_state_is_not_compared(configure: Configure) -> None:
    wheel = {"node_id": 0, "max_torque": 3.0}
    settings = OwnSettings("left", configure(axes={"left": wheel, "right": {**wheel, "node_id": 1}}))
    for setting, value in ((S.VELOCITY_LIMIT, 0.1), (S.CURRENT_LIMIT, 0.1)):
        settings.take(setting, value)
    assert settings.arming_failures(Firmware.V0_5, "left") == []


def test_a_drive_of_0_6_has_one_axis_and_a_board_of_0_5_two(configure: Configure) -> None:
    right = OwnSettings("right", configure())
    assert right.path(Firmware.V0_5, S.WATCHDOG) == "axis1.config.enable_watchdog"
    assert right.path(Firmware.V0_6, S.WATCHDOG) == "axis0.config.enable_watchdog"
    assert set(PATHS[Firmware.V0_5]) == set(OwnSetting)
