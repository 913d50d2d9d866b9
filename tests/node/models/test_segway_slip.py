# SPDX-License-Identifier: MIT
"""Wheels that slip: what is estimated of it, and what they are sent, by hand-made numbers."""

from itertools import pairwise

import pytest

from segway_ecc.node.models.segway import SegwayController
from segway_ecc.node.models.segway_estimate import STANDARD_GRAVITY, Estimate, Estimator, SegwayMeasurement
from segway_ecc.node.models.segway_law import Law, Motion, Phase, PhaseProgress, stopped, torques

PERIOD = 0.005
DEFAULTS = {variable.name: variable.value for variable in SegwayController.parameters}
RADIUS, TRACK = DEFAULTS["WheelRadius"], DEFAULTS["Track"]
ESTIMATOR = Estimator(PERIOD, DEFAULTS)
LAW = Law(PERIOD, {**DEFAULTS, "PitchGain": -10.0, "VelocityGain": -2.0})
LIMIT = 1.3
UP = Estimate(since=1.0)


def measured(left: float = 0.0, right: float = 0.0, *, ahead: float = 0.0, yaw_rate: float = 0.0) -> SegwayMeasurement:
    """An upright robot whose wheels turn at these speeds on their treads, m/s, and which feels `ahead`, m/s2."""
    return SegwayMeasurement(0.0, left / RADIUS, 0.0, right / RADIUS, 0.0, 0.0, yaw_rate, ahead, 0.0, STANDARD_GRAVITY)


def estimated(e: Estimate, m: SegwayMeasurement, periods: int = 1, *, may_slip: bool = True) -> Estimate:
    for _ in range(periods):
        e = ESTIMATOR.advance(e, m, resting=False, may_slip=may_slip)
    return e


def test_wheels_that_spin_where_nothing_is_felt_slip_and_take_the_robot_nowhere() -> None:
    e = estimated(UP, measured(2.0, 2.0))
    assert (e.left_slip, e.right_slip) == pytest.approx((1.8, 1.8), abs=0.01)
    assert e.velocity == pytest.approx(0.2, abs=0.01)
    assert e.rolled == pytest.approx(2.0)
    assert estimated(e, measured(2.0, 2.0), 19).travel < 0.04


def test_each_wheel_has_its_own_slip() -> None:
    e = estimated(UP, measured(0.0, 1.0))
    assert (e.left_slip, e.right_slip) == pytest.approx((0.0, 0.8), abs=0.01)
    assert e.velocity == pytest.approx(0.1, abs=0.01)


def test_wheels_that_do_as_is_felt_roll_and_so_do_they_in_a_turn() -> None:
    e = UP
    for period in range(100):
        speed, yaw_rate = 5.0 * (period + 1) * PERIOD, 2.0
        turned = 0.5 * TRACK * yaw_rate
        e = estimated(e, measured(speed - turned, speed + turned, ahead=5.0, yaw_rate=yaw_rate))
        assert (e.left_slip, e.right_slip) == (0.0, 0.0)
        assert e.velocity == pytest.approx(speed)


@pytest.mark.parametrize("off", [1.3, -1.3])
def test_an_accelerometer_that_is_off_is_not_taken_for_slip(off: float) -> None:
    e = UP
    for _ in range(400):
        e = estimated(e, measured(ahead=off))
        assert e.left_slip == e.right_slip == 0.0


@pytest.mark.parametrize("off", [0.0, 0.6, -0.6])
def test_what_is_taken_for_slip_wrongly_ends(off: float) -> None:
    """The wheels gained 0.6 m/s and the accelerometer felt nothing of it."""
    e = estimated(UP, measured(0.6, 0.6, ahead=off))
    assert e.left_slip > 0.3
    e = estimated(e, measured(0.6, 0.6, ahead=off), 200)
    assert (e.left_slip, e.right_slip) == (0.0, 0.0)
    assert e.velocity == pytest.approx(0.6)


def test_a_blow_is_no_travel() -> None:
    e = estimated(UP, measured(0.0, 0.0, ahead=200.0))
    assert (e.left_slip, e.felt_velocity) == (0.0, 0.0)


def test_where_no_wheel_may_slip_all_is_as_they_roll() -> None:
    e = estimated(UP, measured(2.0, 1.0), 3, may_slip=False)
    assert (e.left_slip, e.right_slip) == (0.0, 0.0)
    assert e.velocity == e.felt_velocity == pytest.approx(1.5)


@pytest.mark.parametrize("phase", Phase)
def test_only_standing_up_takes_so_much_torque_that_wheels_slip(phase: Phase) -> None:
    assert PhaseProgress(phase).may_slip == (phase is Phase.STANDING_UP)


def test_a_wheel_that_slips_is_sent_less_and_the_other_one_what_it_was() -> None:
    motion, slipping = Motion(sent=2.0), Estimate(pitch=0.2, left_slip=0.5)
    sent = []
    for _ in range(10):
        motion = LAW.balanced(motion, slipping, LIMIT)
        sent.append(torques(motion))
    assert sent[0][0] == pytest.approx(0.9 - 0.5 * 0.5 * 3.0), "it comes as foreseen, two periods on"
    assert [right for _left, right in sent] == pytest.approx([1.0] * 10)
    assert sent[2][0] > sent[5][0] > sent[9][0] > 0.0


def test_what_brakes_a_slipping_wheel_is_sent_whole() -> None:
    motion = LAW.balanced(Motion(sent=-1.0), Estimate(pitch=-0.1, left_slip=3.0, right_slip=3.0), LIMIT)
    assert torques(motion) == pytest.approx((-0.5, -0.5))


def test_it_is_sent_more_again_once_it_rolls() -> None:
    motion, leaning = Motion(sent=2.0, left_yield=1.0, right_yield=1.0), Estimate(pitch=0.26)
    sent = []
    for _ in range(100):
        motion = LAW.balanced(motion, leaning, LIMIT)
        sent.append(motion.sent)
    assert sent[0] == pytest.approx(2.0 * (0.3 + 4.0 * LIMIT * PERIOD))
    assert sent[-1] == pytest.approx(2.6)
    assert (motion.left_yield, motion.right_yield) == pytest.approx((0.0, 0.0))


def test_little_torque_is_left_to_a_wheel_that_hardly_slips_and_none_to_one_that_spins() -> None:
    hardly, spinning = Motion(sent=1.0), Motion(sent=1.0)
    for _ in range(200):
        hardly = LAW.balanced(hardly, Estimate(pitch=0.1, left_slip=1e-6, right_slip=1e-6), LIMIT)
        spinning = LAW.balanced(spinning, Estimate(pitch=0.1, left_slip=1.0, right_slip=1.0), LIMIT)
    assert hardly.sent == pytest.approx(2.0 * 0.23 * LIMIT, abs=1e-3)
    assert spinning.sent == 0.0
    assert stopped(hardly).left_yield == 0.0


def rising(motion: Motion, e: Estimate, *, begins: bool = False) -> Motion:
    return LAW.rising(motion, e, LIMIT, begins=begins)


def test_a_robot_that_begins_to_stand_up_is_sent_half_of_its_torque_and_more_while_its_wheels_roll() -> None:
    leaning = Estimate(pitch=0.5)
    motion = rising(Motion(), leaning, begins=True)
    sent = []
    for _ in range(40):
        motion = LAW.balanced(rising(motion, leaning), leaning, LIMIT)
        sent.append(motion.sent)
    assert sent[0] == pytest.approx(LIMIT * (1.0 + 2.0 * 4.0 * PERIOD))
    assert [after - before for before, after in pairwise(sent[:20])] == pytest.approx([2.0 * 4.0 * LIMIT * PERIOD] * 19)
    assert sent[-1] == pytest.approx(2.0 * LIMIT)


def test_a_robot_that_stands_up_keeps_most_of_its_speed_until_it_is_nearly_up() -> None:
    slipped = Motion(left_yield=0.1)
    assert rising(Motion(), Estimate(pitch=0.4, velocity=1.0)).velocity == 0.0
    assert rising(slipped, Estimate(pitch=0.4, velocity=1.0)).velocity == pytest.approx(0.8)
    assert rising(slipped, Estimate(pitch=-0.125, velocity=1.0)).velocity == pytest.approx(0.4)
    assert rising(Motion(velocity=0.4), Estimate(pitch=-0.125, velocity=1.0)).velocity == pytest.approx(0.4)
