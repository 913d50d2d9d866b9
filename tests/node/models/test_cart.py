# SPDX-License-Identifier: MIT
import math
from fractions import Fraction

import pytest

from segway_ecc.hil.case_study.study import Cell, thesis_cells
from segway_ecc.node.models.cart import Cart, CartController

OUTPUTS = [v.name for v in Cart.outputs]
PARAMETERS = {v.name: Fraction(str(v.value)) for v in Cart.parameters}


def run(cart: Cart, linear: float, angular: float, seconds: float) -> dict[str, float]:
    cart.initialize(())
    cart.write("LinearSetpoint", linear)
    cart.write("AngularSetpoint", angular)
    y = [0.0]
    for _ in range(round(seconds / cart.step_size)):
        y = cart.step(())
    return dict(zip(OUTPUTS, y, strict=True))


def test_the_parameters_give_the_transfer_function_that_the_thesis_pins() -> None:
    # From the equations of motor and controller alone, in exact arithmetic:
    # (L s + R) i = kf w_set + kp (w_set - w) - K w and (J s + b) w = K i, so
    # ((L s + R) (J s + b) + K^2 + kp K) w = (kf + kp) K w_set.
    p = PARAMETERS
    k = p["MotorConstant"]
    constant = p["Resistance"] * p["Friction"] + k**2 + p["FeedbackGain"] * k
    a1 = (p["Resistance"] * p["Inertia"] + p["Inductance"] * p["Friction"]) / constant
    a2 = p["Inductance"] * p["Inertia"] / constant
    assert constant == Fraction("0.02")
    assert a1 == Fraction("0.06497")
    assert a2 == Fraction("8.68e-4")


def test_a_wheel_follows_the_step_response_of_that_transfer_function() -> None:
    # 1 / (a2 s^2 + a1 s + 1) has the real poles p, q; its step response is 1 - (q e^pt - p e^qt) / (q - p).
    a1, a2 = 0.06497, 8.68e-4
    root = math.sqrt(a1**2 - 4.0 * a2)
    p, q = (-a1 + root) / (2.0 * a2), (-a1 - root) / (2.0 * a2)
    for t in (0.05, 0.1, 0.2):
        expected = 1.0 - (q * math.exp(p * t) - p * math.exp(q * t)) / (q - p)
        # A step of 0.01 s against poles of 0.02 s: the integration is good for about 1e-4.
        assert run(Cart(), 1.0, 0.0, t)["LinearVelocity"] == pytest.approx(expected, abs=3e-4)


def test_the_speed_settles_at_the_set_point_and_the_turn_at_the_thesis_factor() -> None:
    settled = run(Cart(), 1.5, 0.5, 3.0)
    assert settled["LinearVelocity"] == pytest.approx(1.5, rel=1e-9)
    assert settled["AngularVelocity"] == pytest.approx(0.5 * 1.00174, rel=1e-9)


def test_unit_gain_does_not_depend_on_the_motor() -> None:
    other = Cart({"Resistance": 1.0, "Friction": 2e-3, "MotorConstant": 0.05})
    assert run(other, 1.0, 0.0, 9.0)["LinearVelocity"] == pytest.approx(1.0, rel=1e-9)


def test_turning_to_the_left_turns_the_right_wheel_faster_and_the_cart_towards_y() -> None:
    end = run(Cart(), 1.0, 0.5, 1.0)
    assert end["RightVelocity"] > end["LeftVelocity"] > 0.0
    assert end["Heading"] > 0.0
    assert end["Y"] > 0.0


def test_wheel_angles_are_the_way_rolled() -> None:
    end = run(Cart(), 1.0, 0.0, 5.0)
    assert end["LeftAngle"] * 0.05 == pytest.approx(end["X"], rel=1e-12)
    assert end["RightAngle"] == end["LeftAngle"]


@pytest.mark.parametrize("cell", thesis_cells(), ids=lambda cell: f"{cell.linear:g} m/s {cell.angular:g} rad/s")
def test_every_cell_of_the_thesis_is_met_within_its_rounding(cell: Cell) -> None:
    # The thesis prints centimetres: 0.005 m of rounding, and 0.001 m for its parameters.
    end = run(Cart(), cell.linear, cell.angular, 10.0)
    assert (end["X"], end["Y"]) == pytest.approx(cell.thesis_offline, abs=0.006)


def test_the_thesis_has_twelve_cells() -> None:
    assert len(thesis_cells()) == 12


@pytest.mark.parametrize(
    ("linear", "angular", "left", "right"), [(2.0, 0.0, 0.0, 0.0), (1.0, 0.5, 3.0, -2.0), (-1.0, -2.0, 40.0, 7.0)]
)
def test_the_controller_alone_is_the_cart_s_controller(
    linear: float, angular: float, left: float, right: float
) -> None:
    cart, controller = Cart(), CartController()
    cart.initialize(())
    controller.initialize((0.0, 0.0))
    controller.write("LinearSetpoint", linear)
    controller.write("AngularSetpoint", angular)
    y = dict(zip([v.name for v in CartController.outputs], controller.step((left, right)), strict=True))
    assert (y["LeftVoltage"], y["RightVoltage"]) == cart.voltages(linear, angular, left, right)
    # And both are V = kf w_set + kp (w_set - w), worked out here.
    kf, kp = (0.64536 * 1e-3 + 0.1**2) / 0.1, 0.0935464
    wanted = (linear - angular * 0.300522 / 2.0) / 0.05
    assert y["LeftVoltage"] == pytest.approx(kf * wanted + kp * (wanted - left), rel=1e-12)


def test_the_controller_s_dead_reckoning_follows_the_cart() -> None:
    cart, controller = Cart(), CartController()
    cart.initialize(())
    controller.initialize((0.0, 0.0))
    cart.write("LinearSetpoint", 1.0)
    cart.write("AngularSetpoint", 0.5)
    truth, reckoned = [0.0], [0.0]
    for _ in range(500):
        truth = cart.step(())
        reckoned = controller.step(truth[7:9])
    # It takes the speeds at the ends of the steps for those in between: at 1 m/s that is good for half a step, 5 mm.
    assert reckoned[:2] == pytest.approx(truth[:2], abs=0.01)
    assert reckoned[3:5] == truth[3:5]
