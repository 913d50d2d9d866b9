# SPDX-License-Identifier: MIT
"""Wheels that lose the floor while the robot balances: how that is noticed, and what they are sent, by hand."""

from math import copysign, cos, sin

import pytest
from msgspec.structs import replace

from segway_ecc.node.models.segway import SegwayController
from segway_ecc.node.models.segway_estimate import STANDARD_GRAVITY, Estimate, Estimator, SegwayMeasurement
from segway_ecc.node.models.segway_law import Law, Motion, Phase, PhaseProgress, PhaseRules, torques

PERIOD = 0.005
DEFAULTS = {variable.name: variable.value for variable in SegwayController.parameters}
RADIUS, LEAN = DEFAULTS["WheelRadius"], 0.122
SWING = DEFAULTS["SwingLength"]
PER_MOMENT = (LEAN * STANDARD_GRAVITY - 1.0) / 0.2735
"""By so much, m/s2, a torque of 1 N m takes a body back that does not turn."""
ESTIMATOR = Estimator(PERIOD, {**DEFAULTS, "PitchPerAcceleration": LEAN, "TorquePerAcceleration": 0.2735})
RULES = PhaseRules(PERIOD, DEFAULTS | {"PitchPerAcceleration": LEAN})
LAW = Law(PERIOD, {**DEFAULTS, "PitchGain": -10.0, "VelocityGain": -2.0, "IntegralGain": -1.0})
LIMIT = 1.3
UP = Estimate(since=1.0)


def measured(left: float = 0.0, right: float = 0.0, *, pitch_rate: float = 0.0) -> SegwayMeasurement:
    """An upright robot whose wheels turn at these speeds on their treads, m/s, against the world."""
    left, right = (tread / RADIUS - pitch_rate for tread in (left, right))
    return SegwayMeasurement(0.0, left, 0.0, right, 0.0, pitch_rate, 0.0, 0.0, 0.0, STANDARD_GRAVITY)


def estimated(e: Estimate, m: SegwayMeasurement, sent: float | None, periods: int = 1) -> Estimate:
    for _ in range(periods):
        e = ESTIMATOR.advance(e, m, resting=False, sent=sent)
    return e


def rolling(speed: float) -> Estimate:
    return Estimate(since=1.0, velocity=speed, felt_velocity=speed, left_tread=speed, right_tread=speed)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_wheels_that_gain_what_no_robot_does_have_lost_the_floor_and_take_it_nowhere(way: float) -> None:
    e = estimated(UP, measured(way * 0.5, way * 0.5), way * 0.2)
    assert e.free == PERIOD
    shown = way * PERIOD * (3.0 - 0.2 * PER_MOMENT)
    assert e.velocity == e.felt_velocity == pytest.approx(shown), "drawn to them by 3 m/s2, taken back by the torque"
    assert (e.left_slip, e.right_slip) == pytest.approx((way * 0.3 - shown, way * 0.3 - shown)), "less 0.2 m/s"


def test_each_wheel_loses_it_alone() -> None:
    e = estimated(UP, measured(0.0, 0.5), 0.2)
    assert e.free == PERIOD
    assert (e.left_slip, e.right_slip) == pytest.approx((0.0, 0.3))
    assert e.velocity == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("speed", "sent", "pushed"),
    [
        (0.07, 0.2, 0.0),  # 15 m/s2 are allowed
        (0.12, 1.0, 0.0),  # 27
        (0.12, 0.1, 1.3),  # most of the torque of a period before acts still
        (-0.5, 0.2, 0.0),  # not what its torque does, and the body does not turn
        (0.5, None, 0.0),  # it does not balance
    ],
)
def test_what_a_robot_does_gain_is_no_lost_floor(speed: float, sent: float | None, pushed: float) -> None:
    e = estimated(replace(UP, pushed=pushed), measured(speed, speed), sent)
    assert (e.free, e.left_slip, e.right_slip) == (0.0, 0.0, 0.0)
    assert e.velocity == pytest.approx(speed)


def test_as_the_body_shows_the_axle_to_move_it_is_believed_to_while_the_wheels_roll() -> None:
    fall = PERIOD * (STANDARD_GRAVITY * sin(0.1) - 0.2 * PER_MOMENT)
    e = estimated(replace(UP, pitch=0.1), measured(fall / cos(0.1), fall / cos(0.1)), 0.2)
    assert e.felt_velocity == pytest.approx(fall / cos(0.1))
    e = estimated(UP, measured(0.07, 0.07), 0.2)
    assert e.felt_velocity == pytest.approx(PERIOD * (12.0 - 0.2 * PER_MOMENT)), "or drawn to them by 12 m/s2"


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(
    ("blow", "lost", "sent", "free"),
    [
        (0.3, 0.05, 0.0, PERIOD),
        (0.3, 0.02, 0.0, 0.0),  # of which the wheels show less than a tenth: a gyro that fails
        (0.055, 0.055, 0.0, 0.0),  # 12 m/s2 is no blow
        (0.065, 0.065, 0.0, PERIOD),
        (0.13, 0.13, 1.0, 0.0),  # nor what a torque gives
        (0.14, 0.14, 1.0, PERIOD),
        (-0.3, -0.3, 1.0, 0.0),  # and a push ahead does not stop it
    ],
)
def test_a_blow_that_stops_the_axle_shows_in_body_and_wheels(
    way: float, blow: float, lost: float, sent: float, free: float
) -> None:
    """By how much each shows the axle to get slower in a period, m/s; the treads turn with the body."""
    back = blow - PERIOD * sent * PER_MOMENT  # what the body turns for, besides the torque that holds it back
    m = measured(way * (0.4 - lost), way * (0.4 - lost), pitch_rate=way * back / SWING)
    tread = way * (0.4 - back / SWING * RADIUS)
    e = estimated(replace(rolling(way * 0.4), left_tread=tread, right_tread=tread), m, way * sent)
    assert e.free == free
    assert e.velocity == pytest.approx(way * (0.4 - blow), abs=0.016) or not free


def test_an_axle_that_stops_though_the_body_does_not_turn_is_no_axle_but_a_wheel_on_its_own() -> None:
    assert estimated(rolling(0.4), measured(0.0, 0.0), -0.5).free == PERIOD


def test_a_gyro_that_fails_alone_is_no_lost_floor() -> None:
    m = SegwayMeasurement(0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, STANDARD_GRAVITY)
    assert estimated(UP, m, 1.0).free == 0.0


def test_it_is_over_once_both_wheels_roll() -> None:
    e = estimated(UP, measured(0.0, 0.5), 0.2)
    e = estimated(e, measured(0.0, 0.3), 0.2)
    assert e.free == 2.0 * PERIOD
    e = estimated(e, measured(0.0, 0.1), 0.2)
    assert (e.free, e.right_slip) == (0.0, 0.0)
    assert e.velocity == pytest.approx(0.05, abs=1e-4)


def test_it_is_over_after_half_a_second_and_the_wheels_are_believed() -> None:
    e = estimated(UP, measured(4.0, 4.0), 0.2, 99)
    assert e.free == pytest.approx(0.495)
    assert e.velocity < 1.6
    e = estimated(e, measured(4.0, 4.0), 0.2, 3)
    assert e.free == 0.0
    assert e.velocity == pytest.approx(4.0, abs=1e-3)


def test_a_model_whose_lean_is_not_known_has_a_momentum_too() -> None:
    estimator = Estimator(PERIOD, {**DEFAULTS, "PitchPerAcceleration": 0.0})
    assert estimator.advance(UP, measured(0.5, 0.5), resting=False, sent=0.2).free == PERIOD


def spun(e: Estimate, left: float, right: float, force: float = STANDARD_GRAVITY, *, sent: float = 0.7) -> Estimate:
    return estimated(e, replace(measured(left, right), acceleration_z=force), copysign(sent, left))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_one_whose_wheels_both_spin_alike_while_its_body_is_carried_is_lifted(way: float) -> None:
    e = UP
    for period in range(1, 5):
        e = spun(e, way * (0.5 + 0.2 * period), way * (0.4 + 0.2 * period))
        assert e.lifted == pytest.approx(period * PERIOD)
    assert spun(e, way * 1.2, 0.0).lifted == 0.0, "that one rolls"


@pytest.mark.parametrize(("sent", "counts"), [(0.61, 1.0), (0.59, 2.0)])
def test_wheels_that_spin_with_less_torque_than_any_floor_carries_are_sure_to_have_none(
    sent: float, counts: float
) -> None:
    assert spun(UP, 0.7, 0.7, sent=sent).lifted == pytest.approx(counts * PERIOD)


@pytest.mark.parametrize("force", [0.49 * STANDARD_GRAVITY, 2.01 * STANDARD_GRAVITY])
def test_one_that_leaps_or_was_struck_is_not_lifted(force: float) -> None:
    e = spun(UP, 0.7, 0.7, force)
    assert (e.free, e.lifted) == (PERIOD, 0.0)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (1.5, 0.45),  # of which one slips five times as fast
        (0.7, 0.45),  # of which one is braked by the floor
        (0.7, -0.7),
        (0.0, 0.7),
    ],
)
def test_one_whose_wheels_spin_otherwise_is_not_lifted(left: float, right: float) -> None:
    e = spun(replace(UP, left_tread=0.55, right_tread=0.55), 0.75, 0.75)
    assert e.lifted == PERIOD
    e = spun(e, left, right)
    assert e.free > 0.0
    assert e.lifted == 0.0


@pytest.mark.parametrize(("lifted", "phase"), [(0.015, Phase.BALANCING), (0.02, Phase.LIFTED)])
def test_it_counts_as_lifted_after_20_ms(lifted: float, phase: Phase) -> None:
    e = replace(UP, lifted=lifted)
    assert RULES.advance(PhaseProgress(Phase.BALANCING), e, stand=True).phase is phase
    assert RULES.advance(PhaseProgress(Phase.STANDING_UP), e, stand=True).phase is Phase.STANDING_UP


@pytest.mark.parametrize("stand", [True, False])
def test_a_lifted_robot_gives_up_once_its_wheels_rest_and_begins_anew_when_asked(*, stand: bool) -> None:
    progress = PhaseProgress(Phase.LIFTED)
    for speed in (0.5, 0.06, 0.04, -0.06) + (0.04,) * 5:
        progress = RULES.advance(progress, replace(UP, left_tread=speed, right_tread=0.0), stand=stand)
        assert progress.phase is Phase.LIFTED
    progress = RULES.advance(progress, UP, stand=stand)
    assert progress.phase is Phase.GIVEN_UP
    assert progress.is_resting
    assert RULES.advance(progress, UP, stand=stand).phase is (Phase.GIVEN_UP if stand else Phase.RESTING)


def test_wheels_that_do_not_stop_are_not_braked_for_ever() -> None:
    progress = PhaseProgress(Phase.LIFTED)
    turns = replace(UP, left_tread=1.0, right_tread=1.0)
    phases = []
    for _ in range(62):
        progress = RULES.advance(progress, turns, stand=True)
        phases.append(progress.phase)
    assert set(phases[:60]) == {Phase.LIFTED}
    assert phases[-1] is Phase.GIVEN_UP, "after 0.3 s"


@pytest.mark.parametrize(
    ("speed", "before", "brake"),
    [
        (1.0, 1.0, -0.12),
        (-1.0, -1.0, 0.12),
        (1.0, 1.5, -0.06),  # it stops already
        (0.5, 0.6, -0.048),
        (5.0, 5.0, -0.45),
    ],
)
def test_each_wheel_of_a_lifted_robot_is_braked_by_its_own_speed(speed: float, before: float, brake: float) -> None:
    motion = Motion(sent=0.3, left_slip=before)
    motion = LAW.lifted(motion, replace(UP, pitch=0.2, left_tread=speed), LIMIT)
    assert torques(motion) == pytest.approx((brake, 0.0))
    assert (motion.sent_before, motion.left_slip, motion.right_slip) == (0.3, speed, 0.0)
    motion = LAW.lifted(Motion(), replace(UP, right_tread=-5.0), 0.2)
    assert torques(motion) == pytest.approx((0.0, 0.2)), "no more than it may have"


@pytest.mark.parametrize(("inertia", "periods"), [(0.7, 2), (1.0, 2), (1.3, 2), (0.7, 3), (1.0, 3), (1.3, 3)])
def test_its_wheels_stop_within_90_ms_whatever_they_weigh_and_however_late_a_torque_acts(
    inertia: float, periods: int
) -> None:
    """The wheel by itself: J dw/dt = u, with the Coulomb friction of the published robot left out."""
    speed, per_torque = 1.0, RADIUS * PERIOD / (inertia * 1.723e-4)
    motion, under_way = Motion(left_slip=speed), [0.0] * periods
    speeds = []
    for _ in range(40):
        motion = LAW.lifted(motion, replace(UP, left_tread=speed), LIMIT)
        under_way.append(torques(motion)[0])
        speed += per_torque * under_way.pop(0)
        speeds.append(speed)
    assert max(map(abs, speeds[18:])) < 0.1


@pytest.mark.parametrize("phase", Phase)
def test_only_one_that_is_up_balances(phase: Phase) -> None:
    assert PhaseProgress(phase).balances == (phase is Phase.BALANCING)
    assert not PhaseProgress(phase, lasting=PERIOD).balances, "it lies"


def test_the_reference_waits_for_a_robot_whose_wheel_is_stopped_or_free_and_a_while_on() -> None:
    motion, e = Motion(travel=1.0, velocity=0.5), Estimate(travel=0.7, velocity=0.4, free=PERIOD)
    motion = LAW.ramped(motion, e, 0.5, 0.0)
    assert motion.velocity == pytest.approx(0.32)
    assert motion.acceleration == 0.0
    assert motion.travel == pytest.approx(0.7 + 0.32 * PERIOD)
    e = replace(e, free=0.0)
    for _ in range(39):
        motion = LAW.ramped(motion, e, 0.5, 0.0)
    assert motion.velocity == pytest.approx(0.32)
    for _ in range(400):
        motion = LAW.ramped(motion, e, 0.5, 0.0)
    assert motion.velocity == pytest.approx(0.5, abs=0.02)


def sent_up(e: Estimate, motion: Motion | None = None) -> Motion:
    return LAW.balanced(Motion() if motion is None else motion, e, LIMIT, is_up=True)


@pytest.mark.parametrize(("held", "factor"), [(0.0, 1.0), (0.1, 1.5)])
def test_while_the_reference_waits_the_pitch_rate_counts_half_more(held: float, factor: float) -> None:
    law = Law(PERIOD, {**DEFAULTS, "PitchRateGain": -2.0})
    motion = law.balanced(Motion(held=held), Estimate(pitch_rate=0.4), LIMIT, is_up=True)
    assert motion.sent == pytest.approx(0.8 * factor)


@pytest.mark.parametrize(("slip", "brake"), [(1.0, -0.25), (-1.0, 0.25), (3.0, -0.45), (0.2, -0.05)])
def test_where_the_body_falls_freely_both_wheels_are_braked_whatever_it_leans(slip: float, brake: float) -> None:
    falls = Estimate(pitch=0.2, left_slip=slip, right_slip=slip, falling=0.015)
    assert torques(sent_up(falls)) == pytest.approx((brake, brake))
    bounces = sent_up(replace(falls, falling=0.01), Motion(left_slip=slip, right_slip=slip))
    assert min(torques(bounces)) > 0.0


def test_a_body_that_feels_less_than_half_its_weight_falls() -> None:
    spins = replace(measured(0.5, 0.5), acceleration_z=0.49 * STANDARD_GRAVITY)
    e = estimated(estimated(UP, spins, 0.2), replace(spins, left_velocity=20.0), 0.2)
    assert e.falling == pytest.approx(2.0 * PERIOD)
    assert estimated(e, replace(spins, acceleration_z=0.51 * STANDARD_GRAVITY), 0.2).falling == 0.0
    assert estimated(UP, replace(measured(), acceleration_z=0.0), 0.2).falling == 0.0, "on its wheels"


@pytest.mark.parametrize(
    ("slip", "before", "left"),
    [
        (0.9, 0.9, 1.0),
        (1.4, 1.4, 1.0),  # it may have 1.1
        (2.0, 2.0, 0.8),
        (2.0, 1.0, 0.3),  # by its lead of a period it slips 3 then
        (4.0, 4.0, -0.2),
        (6.0, 6.0, -0.45),
        (-2.0, -2.0, 1.0),  # the torque brakes it
    ],
)
def test_a_wheel_that_spins_faster_than_1_m_s_is_sent_less_and_the_other_one_what_it_was(
    slip: float, before: float, left: float
) -> None:
    motion = sent_up(Estimate(pitch=0.2, left_slip=slip), Motion(left_slip=before))
    assert torques(motion) == pytest.approx((left, 1.0))
    mirrored = sent_up(Estimate(pitch=-0.2, right_slip=-slip), Motion(right_slip=-before))
    assert torques(mirrored) == pytest.approx((-1.0, -left))


def test_no_wheel_is_braked_with_more_than_it_may_have() -> None:
    spins = Estimate(pitch=0.2, left_slip=6.0)
    assert torques(LAW.balanced(Motion(left_slip=6.0), spins, 0.3, is_up=True)) == pytest.approx((-0.3, 0.3))
    falls = Estimate(pitch=0.2, left_slip=6.0, falling=0.02)
    assert torques(LAW.balanced(Motion(), falls, 0.3, is_up=True)) == pytest.approx((-0.3, 0.0))


def test_the_integral_waits_and_the_next_slip_begins_at_none() -> None:
    motion = sent_up(Estimate(travel=0.1, left_slip=0.5), Motion(integral=0.2))
    assert (motion.integral, motion.left_slip) == (0.2, 0.5)
    motion = sent_up(Estimate(travel=0.1), motion)
    assert motion.integral > 0.2
    assert (motion.left_slip, motion.right_slip) == (0.0, 0.0)
