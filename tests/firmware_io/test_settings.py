# SPDX-License-Identifier: MIT
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.settings import WheelSettings

RATIOS = st.floats(0.01, 1_000.0)
DIRECTIONS: st.SearchStrategy[Literal[1, -1]] = st.sampled_from([1, -1])
VALUES = st.floats(-1e6, 1e6)


def test_without_a_gear_motor_and_wheel_are_one() -> None:
    wheel = WheelSettings(max_torque=1.0)
    assert wheel.wheel(3.0) == wheel.motor(3.0) == 3.0
    assert wheel.motor_torque(3.0) == wheel.wheel_torque(3.0) == 3.0


@pytest.mark.parametrize("direction", [1, -1])
def test_a_geared_motor_turns_faster_and_pulls_less_than_its_wheel(direction: Literal[1, -1]) -> None:
    wheel = WheelSettings(gear_ratio=4.0, direction=direction, max_torque=1.0)
    assert wheel.wheel(8.0) == 2.0 * direction
    assert wheel.motor(2.0) == 8.0 * direction
    assert wheel.motor_torque(8.0) == 2.0 * direction
    assert wheel.wheel_torque(2.0) == 8.0 * direction


@given(RATIOS, DIRECTIONS, VALUES, VALUES)
def test_there_and_back_is_the_same_and_no_power_is_made_or_lost(
    ratio: float, direction: Literal[1, -1], speed: float, torque: float
) -> None:
    wheel = WheelSettings(gear_ratio=ratio, direction=direction, max_torque=1.0)
    assert wheel.wheel(wheel.motor(speed)) == pytest.approx(speed, rel=1e-12)
    assert wheel.wheel_torque(wheel.motor_torque(torque)) == pytest.approx(torque, rel=1e-12)
    at_motor = wheel.motor(speed) * wheel.motor_torque(torque)
    assert at_motor == pytest.approx(speed * torque, rel=1e-12)
