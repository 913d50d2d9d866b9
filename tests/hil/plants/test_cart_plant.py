# SPDX-License-Identifier: MIT
"""The plant of the cart, against its equations solved by hand and against the whole cart in one model."""

import itertools
import math

import pytest

from segway_ecc.hil.plants.cart import CartPlant, CartTorquePlant
from segway_ecc.node.models.cart import Cart

RESISTANCE, INDUCTANCE, INERTIA, FRICTION, MOTOR_CONSTANT = 0.64536, 8.68e-3, 2e-3, 1e-3, 0.1
RADIUS, TRACK, ASSUMED_TRACK = 0.05, 0.3, 0.300522
FEEDFORWARD = (RESISTANCE * FRICTION + MOTOR_CONSTANT**2) / MOTOR_CONSTANT
FEEDBACK = 0.0935464
REST = (0.0, 0.0)


def _run(voltages: tuple[float, float], seconds: float = 2.0) -> dict[str, float]:
    plant = CartPlant()
    outputs = plant.initialize(REST)
    for _ in range(round(seconds / plant.step_size)):
        outputs = plant.step(voltages)
    return dict(zip((v.name for v in plant.outputs), outputs, strict=True))


def test_rests_without_voltage() -> None:
    assert {name for name, value in _run((0.0, 0.0)).items() if value != 0.0} == {"imu.linear_acceleration_z"}


def test_equal_voltages_go_straight_ahead() -> None:
    end = _run((5.0, 5.0))
    assert end["left.angle"] == end["right.angle"] > 0
    assert end["truth.x"] == pytest.approx(RADIUS * end["left.angle"])
    assert (end["truth.y"], end["truth.heading"], end["truth.angular_velocity"]) == (0.0, 0.0, 0.0)


def test_negative_voltages_go_back() -> None:
    forward, back = _run((5.0, 5.0)), _run((-5.0, -5.0))
    assert forward.pop("imu.linear_acceleration_z") == back.pop("imu.linear_acceleration_z") == 9.80665
    assert back == pytest.approx({name: -value for name, value in forward.items()})


def test_more_on_the_right_turns_left() -> None:
    end = _run((4.0, 5.0), seconds=0.5)
    assert end["right.velocity"] > end["left.velocity"] > 0
    assert end["truth.heading"] > 0
    assert end["truth.y"] > 0
    mirrored = _run((5.0, 4.0), seconds=0.5)
    assert mirrored["truth.heading"] == pytest.approx(-end["truth.heading"])
    assert mirrored["truth.y"] == pytest.approx(-end["truth.y"])
    assert mirrored["truth.x"] == pytest.approx(end["truth.x"])


def test_opposite_voltages_turn_on_the_spot() -> None:
    end = _run((-5.0, 5.0))
    assert (end["truth.x"], end["truth.y"]) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert end["truth.heading"] == pytest.approx(2 * RADIUS / TRACK * end["right.angle"])


def test_settles_at_the_speeds_the_equations_give() -> None:
    """di/dt = dw/dt = 0 gives w = K V / (R b + K^2)."""
    end = _run((6.0, 12.0), seconds=5.0)
    left, right = 6.0 / FEEDFORWARD, 12.0 / FEEDFORWARD
    assert (end["left.velocity"], end["right.velocity"]) == pytest.approx((left, right))
    assert end["truth.linear_velocity"] == pytest.approx(RADIUS * (left + right) / 2)
    assert end["truth.angular_velocity"] == pytest.approx(RADIUS * (right - left) / TRACK)


def _stored(plant: CartPlant) -> float:
    """Energy in a motor's inductance and its wheel's inertia, J."""
    return 0.5 * INDUCTANCE * plant.read("LeftCurrent") ** 2 + 0.5 * INERTIA * plant.read("LeftSpeed") ** 2


def test_with_shorted_motors_energy_only_leaves() -> None:
    plant = CartPlant()
    plant.initialize(REST)
    for _ in range(100):
        plant.step((12.0, 12.0))
    energies = []
    for _ in range(200):
        energies.append(_stored(plant))
        plant.step(REST)
    assert energies == sorted(energies, reverse=True)
    assert energies[-1] < 1e-6 * energies[0]


def test_what_the_supply_gives_is_stored_or_lost() -> None:
    class FinePlant(CartPlant):
        step_size = 0.0002

    plant = FinePlant()
    plant.initialize(REST)
    balance, power = 0.0, 0.0
    for _ in range(1000):
        plant.step((12.0, 0.0))
        current, speed = plant.read("LeftCurrent"), plant.read("LeftSpeed")
        power, before = 12.0 * current - RESISTANCE * current**2 - FRICTION * speed**2, power
        balance += 0.5 * (power + before) * plant.step_size
    assert balance == pytest.approx(_stored(plant), rel=1e-4)


def _closed_loop(step_s: float, linear: float, angular: float, seconds: float) -> list[float]:
    """Where the cart is after a while with its own controller around the plant, sampled once per step."""

    class SteppedPlant(CartPlant):
        step_size = step_s

    plant = SteppedPlant()
    names = [v.name for v in plant.outputs]
    left_index, right_index = names.index("left.velocity"), names.index("right.velocity")
    steer = angular * ASSUMED_TRACK / 2
    left_set, right_set = (linear - steer) / RADIUS, (linear + steer) / RADIUS
    y = plant.initialize(REST)
    for _ in range(round(seconds / step_s)):
        left = FEEDFORWARD * left_set + FEEDBACK * (left_set - y[left_index])
        right = FEEDFORWARD * right_set + FEEDBACK * (right_set - y[right_index])
        y = plant.step((left, right))
    return [y[names.index(f"truth.{part}")] for part in ("x", "y", "heading")]


def test_with_its_controller_it_converges_to_the_whole_cart() -> None:
    cart = Cart()
    cart.initialize(())
    cart.write("LinearSetpoint", 1.0)
    cart.write("AngularSetpoint", 0.5)
    for _ in range(100):
        whole = cart.step(())

    errors = [math.dist(_closed_loop(step, 1.0, 0.5, 1.0), whole[:3]) for step in (0.004, 0.002, 0.001, 0.0005)]

    # Sampling the controller delays it by half a step on average: an error of first order, which halves with the step.
    ratios = [coarse / fine for coarse, fine in itertools.pairwise(errors)]
    assert ratios == pytest.approx([2.0, 2.0, 2.0], rel=0.15)
    assert errors[-1] < 1e-3


def test_the_imu_measures_how_the_truth_changes() -> None:
    """Differences of the true velocity, turned into the cart's frame, over one fine step."""

    class FinePlant(CartPlant):
        step_size = 0.0001

    plant = FinePlant()
    names = [v.name for v in plant.outputs]
    plant.initialize(REST)
    for _ in range(3000):
        before = dict(zip(names, plant.step((6.0, 9.0)), strict=True))
    after = dict(zip(names, plant.step((6.0, 9.0)), strict=True))

    def velocity(y: dict[str, float]) -> tuple[float, float]:
        speed, heading = y["truth.linear_velocity"], y["truth.heading"]
        return speed * math.cos(heading), speed * math.sin(heading)

    (vx, vy), (wx, wy) = velocity(before), velocity(after)
    ax, ay, heading = (wx - vx) / 0.0001, (wy - vy) / 0.0001, after["truth.heading"]
    assert after["imu.linear_acceleration_x"] == pytest.approx(
        ax * math.cos(heading) + ay * math.sin(heading), rel=2e-3
    )
    assert after["imu.linear_acceleration_y"] == pytest.approx(
        ay * math.cos(heading) - ax * math.sin(heading), rel=2e-3
    )
    assert after["imu.angular_velocity_z"] == after["truth.angular_velocity"]


def test_torques_turn_the_wheels_as_in_the_equations() -> None:
    """J dw/dt = T - b w gives w = T / b (1 - exp(-b t / J)) from rest."""
    plant = CartTorquePlant()
    names = [v.name for v in plant.outputs]
    plant.initialize(REST)
    for _ in range(200):
        end = dict(zip(names, plant.step((0.02, -0.01)), strict=True))
    grown = 1.0 - math.exp(-FRICTION * 1.0 / INERTIA)
    assert end["left.velocity"] == pytest.approx(0.02 / FRICTION * grown)
    assert end["right.velocity"] == pytest.approx(-0.01 / FRICTION * grown)
    assert end["truth.angular_velocity"] == pytest.approx(RADIUS * (-0.03 / FRICTION * grown) / TRACK)


def test_a_motor_current_as_torque_moves_the_cart_as_its_voltage_does() -> None:
    """The torque plant driven by K i of the voltage plant goes where that one goes."""

    class FinePlant(CartPlant):
        step_size = 0.0005

    class FineTorquePlant(CartTorquePlant):
        step_size = 0.0005

    by_voltage, by_torque = FinePlant(), FineTorquePlant()
    for plant in (by_voltage, by_torque):
        plant.initialize(REST)
    for _ in range(2000):
        current = (by_voltage.read("LeftCurrent"), by_voltage.read("RightCurrent"))
        there = by_voltage.step((6.0, 8.0))
        here = by_torque.step([MOTOR_CONSTANT * i for i in current])
    assert here[4:7] == pytest.approx(there[4:7], abs=2e-3)
