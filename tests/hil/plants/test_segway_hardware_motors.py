# SPDX-License-Identifier: MIT
"""The segway's motors and battery, against a motor integrated in tiny steps and against what hands can work out."""

import dataclasses
import math

import pytest

from segway_ecc.hil.plants.segway_hardware import MOST_STEPS, Battery, TorqueMotor, VoltageMotor
from segway_ecc.node.models.segway_parameters import PUBLISHED

H = 0.0025
FULL = 18.0
SLOW = dataclasses.replace(PUBLISHED, motor_inductance=2e-4, torque_limit=5.0)
"""With a time constant of the step's size, so that the lag shows."""


def test_current_follows_the_motors_equation() -> None:
    motor, current, mean, tiny = VoltageMotor(SLOW, H), 0.0, 0.0, 1e-6
    for _ in range(3):
        torque = motor.torque(1.5, 20.0, FULL)
        mean = 0.0
        for _ in range(round(H / tiny)):
            mean += current * tiny / H
            current += tiny * (1.5 - 0.075 * current - 0.0251 * 20.0) / 2e-4
        assert motor.value == pytest.approx(current, rel=1e-3)
        assert torque == pytest.approx(0.0251 * mean, rel=2e-3)


@pytest.mark.parametrize("motor", [VoltageMotor, TorqueMotor])
@pytest.mark.parametrize("steps", range(1, MOST_STEPS + 1))
def test_steps_at_once_are_as_good_as_one_after_the_other(motor: type[VoltageMotor | TorqueMotor], steps: int) -> None:
    slow = dataclasses.replace(SLOW, torque_time_constant=4e-3)
    at_once, stepwise = motor(slow, H), motor(slow, H)
    for command in (0.2, -0.1):
        torque = at_once.torque(command, 3.0, FULL, steps)
        torques, powers = zip(
            *((stepwise.torque(command, 3.0, FULL), stepwise.power) for _ in range(steps)), strict=True
        )
        assert torque == pytest.approx(sum(torques) / steps)
        assert at_once.value == pytest.approx(stepwise.value)
        assert at_once.power == pytest.approx(sum(powers) / steps)


def test_settles_at_the_torque_the_equation_gives() -> None:
    motor = VoltageMotor(PUBLISHED, H)
    torques = [motor.torque(2.0, 30.0, FULL) for _ in range(20)]
    assert torques[-1] == pytest.approx(0.0251 * (2.0 - 0.0251 * 30.0) / 0.075)
    assert motor.power == pytest.approx(2.0 * (2.0 - 0.0251 * 30.0) / 0.075)


def test_gears_multiply_torque_and_speed() -> None:
    motor = VoltageMotor(dataclasses.replace(PUBLISHED, gear_ratio=3.0, torque_limit=50.0), H)
    torques = [motor.torque(2.0, 5.0, FULL) for _ in range(20)]
    assert torques[-1] == pytest.approx(3 * 0.0251 * (2.0 - 0.0251 * 3 * 5.0) / 0.075)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("speed", [0.0, 40.0, -40.0])
def test_the_drive_limits_the_current(sign: float, speed: float) -> None:
    motor = VoltageMotor(PUBLISHED, H)
    torques = [motor.torque(sign * 18.0, speed, FULL) for _ in range(20)]
    assert torques[-1] == pytest.approx(sign * 1.7)


def test_no_voltage_beyond_the_supply() -> None:
    """At a speed whose back-EMF is the supply's voltage no command drives any further."""
    motor = VoltageMotor(PUBLISHED, H)
    speed = 10.0 / 0.0251
    torques = [motor.torque(18.0, speed, 10.0) for _ in range(20)]
    assert torques[-1] == pytest.approx(0.0, abs=1e-9)


def test_without_voltage_a_turning_motor_brakes() -> None:
    motor = VoltageMotor(PUBLISHED, H)
    torques = [motor.torque(0.0, 10.0, FULL) for _ in range(20)]
    assert torques[-1] == pytest.approx(-(0.0251**2) * 10.0 / 0.075)
    assert motor.power == pytest.approx(0.0, abs=1e-12)


def test_torque_follows_as_a_first_order_lag() -> None:
    motor = TorqueMotor(PUBLISHED, H)
    first = motor.torque(1.0, 0.0, FULL)
    assert motor.value == pytest.approx(1.0 - math.exp(-2.5))
    assert first == pytest.approx(1.0 - (1.0 - math.exp(-2.5)) / 2.5)
    assert motor.torque(0.0, 0.0, FULL) == pytest.approx(motor.value * (math.exp(2.5) - 1.0) / 2.5)


def test_torque_without_lag_is_there_at_once() -> None:
    motor = TorqueMotor(dataclasses.replace(PUBLISHED, torque_time_constant=0.0), H)
    assert motor.torque(0.7, 0.0, FULL) == motor.value == 0.7


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_torque_is_limited(sign: float) -> None:
    motor = TorqueMotor(PUBLISHED, H)
    torques = [motor.torque(sign * 9.0, 0.0, FULL) for _ in range(20)]
    assert torques[-1] == pytest.approx(sign * 1.7)


def test_torque_goes_no_further_than_the_voltage_reaches() -> None:
    motor = TorqueMotor(PUBLISHED, H)
    speed = 160.0
    torques = [motor.torque(1.7, speed, 6.0) for _ in range(20)]
    assert torques[-1] == pytest.approx(0.0251 * (6.0 - 0.0251 * speed) / 0.075)
    assert torques[-1] < 1.0
    assert motor.power == pytest.approx(6.0 * torques[-1] / 0.0251)


def test_power_of_torque_is_what_moves_and_what_heats() -> None:
    motor = TorqueMotor(PUBLISHED, H)
    for _ in range(20):
        motor.torque(0.5, 20.0, FULL)
    assert motor.power == pytest.approx(0.5 * 20.0 + 0.075 * (0.5 / 0.0251) ** 2)


def test_the_battery_sags_under_load_and_comes_back() -> None:
    """V^2 - V0 V + Rb P = 0 at 200 W: V = 9 + sqrt(81 - 20)."""
    battery = Battery(PUBLISHED)
    assert battery.voltage == 18.0
    for _ in range(20):
        battery.deliver(200.0)
    assert battery.voltage == pytest.approx(9.0 + math.sqrt(61.0))
    battery.deliver(0.0)
    assert battery.voltage == 18.0


def test_what_is_given_back_raises_the_voltage() -> None:
    battery = Battery(PUBLISHED)
    battery.deliver(-90.0)
    assert battery.voltage == pytest.approx(18.5)


def test_the_battery_gives_most_at_half_its_voltage() -> None:
    battery = Battery(PUBLISHED)
    for _ in range(20):
        battery.deliver(1e4)
    assert battery.voltage == 9.0
