# SPDX-License-Identifier: MIT
import math
import random

import pytest

from segway_ecc.node.safety.check import View
from segway_ecc.node.safety.plausibility import (
    MOVING,
    Frozen,
    RangeCheck,
    VelocityAgreement,
    WheelSpeed,
    YawAgreement,
)
from segway_ecc.node.safety.settings import VelocityConsistency, YawConsistency

STEP = 0.005
MS_100 = 20


def see(*values: float, valid: bool = True, periods: int = 1, elapsed_s: float | None = None) -> View:
    return View(values, (valid,) * len(values), periods, elapsed_s=elapsed_s)


def encoder() -> Frozen:
    return Frozen("the left encoder", [0, 1], MS_100, [1])


def imu() -> Frozen:
    return Frozen("the IMU", [0, 1], MS_100, None)


def cycles_until(check: Frozen, view: View, at_most: int = 60) -> int | None:
    """How many cycles after the first with these values it tripped."""
    return next((n for n in range(at_most) if check.look(view) is not None), None)


def test_moving_begins_at_half_a_radian_per_second() -> None:
    assert MOVING == 0.5


@pytest.mark.parametrize("velocity", [0.51, -0.51, 40.0])
def test_frozen_encoder_of_a_moving_wheel_faults_after_its_time(velocity: float) -> None:
    check = encoder()
    assert cycles_until(check, see(1.0, velocity)) == MS_100
    assert check.look(see(1.0, velocity)) == "the left encoder is frozen: 21 periods without a change"


@pytest.mark.parametrize("velocity", [0.0, 0.5, -0.5])
def test_a_wheel_at_rest_may_repeat_itself_for_ever(velocity: float) -> None:
    assert cycles_until(encoder(), see(1.0, velocity), 1000) is None


def test_a_slow_wheel_that_a_coarse_encoder_shows_in_steps_is_not_frozen() -> None:
    check = encoder()
    quantum = 2.0 * math.pi / 128.0
    for step in range(2000):
        assert check.look(see(math.floor(0.55 * step * STEP / quantum) * quantum, 0.55)) is None


def test_time_at_rest_does_not_count() -> None:
    check = encoder()
    cycles_until(check, see(1.0, 0.0), 100)
    assert cycles_until(check, see(1.0, 5.0)) == MS_100


def test_any_one_value_that_changes_is_life() -> None:
    check = imu()
    for n in range(100):
        assert check.look(see(1.0, float(n // (MS_100 - 1)))) is None


def test_noisy_imu_that_repeats_is_frozen_even_at_rest() -> None:
    check = imu()
    assert cycles_until(check, see(0.0, 0.0)) == MS_100
    assert check.look(see(0.0, 1e-9)) is None, "one change ends it"
    assert cycles_until(check, see(0.0, 1e-9)) == MS_100 - 1, "the first of which was the change"


def test_the_other_wheel_s_motion_counts_where_it_is_asked_for() -> None:
    check = Frozen("the IMU", [0], MS_100, [1, 2])
    assert cycles_until(check, see(3.0, 0.0, 0.0), 100) is None
    assert cycles_until(check, see(3.0, 0.0, -9.0)) == MS_100 - 1
    assert check.needs == (0, 1, 2)


def test_skipped_periods_count() -> None:
    check = imu()
    check.look(see(1.0, 1.0))
    assert check.look(see(1.0, 1.0, periods=MS_100 - 1)) is None
    assert check.look(see(1.0, 1.0)) is not None


def test_values_that_are_not_valid_are_not_counted_and_begin_anew() -> None:
    check = imu()
    cycles_until(check, see(1.0, 1.0), MS_100)
    assert check.look(see(1.0, 1.0, valid=False)) is None
    assert cycles_until(check, see(1.0, 1.0)) == MS_100


YAW = YawConsistency(track=0.5, wheel_radius=0.1, tolerance_rad_s=0.5, for_s=0.05)


def yaw() -> YawAgreement:
    return YawAgreement(0, 1, 2, YAW, STEP)


def test_agreeing_wheels_and_gyro_never_fault() -> None:
    check = yaw()
    for right in (-20.0, 0.0, 5.0, 20.0):
        for _ in range(50):
            assert check.look(see(5.0, right, (right - 5.0) * 0.2 + 0.49)) is None
            assert check.look(see(5.0, right, (right - 5.0) * 0.2 - 0.49)) is None


def spinning(view: View) -> View:
    """The same while a wheel has lost the floor."""
    view.spins = True
    return view


def test_a_wheel_that_has_lost_the_floor_says_nothing_of_the_yaw_and_what_was_counted_begins_anew() -> None:
    check, off = yaw(), see(0.0, 20.0, 0.0)
    found = [check.look(view) is None for view in [spinning(see(0.0, 20.0, 0.0))] * 20 + [off] * 9]
    assert all(found)
    assert check.look(spinning(see(0.0, 20.0, 0.0))) is None
    assert [check.look(off) is None for _ in range(10)] == [True] * 9 + [False]


def test_a_wheel_may_be_too_fast_while_it_has_lost_the_floor() -> None:
    check = WheelSpeed("left.velocity", 0, -10.0, 10.0, "rad/s")
    assert check.look(see(11.0, 0.0)) == "left.velocity is 11.00 rad/s, allowed is -10 to 10 rad/s"
    assert check.look(spinning(see(11.0, 0.0))) is None


def test_a_difference_at_the_tolerance_is_allowed() -> None:
    check = yaw()
    assert all(check.look(see(0.0, 0.0, 0.5)) is None for _ in range(50))


@pytest.mark.parametrize("gyro", [1.51, 0.49])
def test_disagreeing_wheels_and_gyro_fault_after_their_time(gyro: float) -> None:
    check = yaw()
    told = [check.look(see(-1.0, 4.0, gyro)) for _ in range(11)]
    assert told[:9] == [None] * 9
    assert told[9] == told[10] == f"the wheels turn the robot at 1.00 rad/s, the gyro reads {gyro:.2f} rad/s"


def test_a_short_slip_is_forgiven_and_counted_from_the_start_again() -> None:
    check = yaw()
    for _ in range(5):
        assert [check.look(see(0.0, 9.0, 0.0)) for _ in range(9)] == [None] * 9
        assert check.look(see(0.0, 0.0, 0.0)) is None


def test_skipped_periods_count_for_the_yaw_and_lost_signals_end_it() -> None:
    check = yaw()
    assert check.look(see(0.0, 9.0, 0.0, periods=9)) is None
    assert check.look(see(0.0, 9.0, 0.0, valid=False, periods=9)) is None
    assert check.look(see(0.0, 9.0, 0.0, periods=9)) is None
    assert check.look(see(0.0, 9.0, 0.0)) is not None
    assert check.needs == (0, 1, 2)


def test_a_yaw_rate_that_is_no_number_does_not_agree() -> None:
    check = yaw()
    assert [check.look(see(0.0, 0.0, math.nan)) is None for _ in range(10)] == [True] * 9 + [False]


def velocity(for_s: float = 0.1) -> VelocityAgreement:
    settings = VelocityConsistency(tolerance_rad_s=0.5, for_s=for_s)
    return VelocityAgreement("left", 0, 1, settings, STEP)


def test_angle_and_velocity_of_a_true_motion_agree() -> None:
    """A swing of up to 16 rad/s in steps of a 4096-count encoder, the velocity with a little noise."""
    check, noise, quantum = velocity(), random.Random(1), 2.0 * math.pi / 4096.0  # noqa: S311 - noise, no secret
    for step in range(3000):
        t = step * STEP
        angle, speed = 8.0 * math.sin(2.0 * t), 16.0 * math.cos(2.0 * t)
        assert check.look(see(round(angle / quantum) * quantum, speed + noise.gauss(0.0, 0.2))) is None


def test_velocity_behind_the_angle_faults_after_the_window() -> None:
    check = velocity()
    told = [check.look(see(5.0 * n * STEP, 4.4)) for n in range(22)]
    assert told[:20] == [None] * 20
    assert told[20] == told[21] == "left.velocity is off by -0.60 rad/s from how left.angle changes"


def test_velocity_ahead_of_the_angle_faults_beyond_the_tolerance_only() -> None:
    ahead, within = velocity(), velocity()
    told = [(ahead.look(see(5.0 * n * STEP, 5.6)), within.look(see(5.0 * n * STEP, 5.49))) for n in range(60)]
    assert told[-1] == ("left.velocity is off by 0.60 rad/s from how left.angle changes", None)
    assert {text for _, text in told} == {None}


def test_a_velocity_that_is_off_by_just_the_tolerance_is_allowed() -> None:
    """All values are binary fractions: nothing is rounded."""
    settings = VelocityConsistency(tolerance_rad_s=0.5, for_s=0.5)
    at_it, beyond = (VelocityAgreement("left", 0, 1, settings, 0.25) for _ in range(2))
    for n in range(20):
        assert at_it.look(see(0.125 * n, 0.0)) is None
        assert (beyond.look(see(0.126 * n, 0.0)) is None) == (n < 2)


def test_what_repeats_is_no_sample_only_while_the_wheel_moves() -> None:
    """A wheel at rest repeats itself, and what its velocity is off by then is told; see `MOVING`."""
    settings = VelocityConsistency(tolerance_rad_s=0.2, for_s=0.1)
    rests, moves = (VelocityAgreement("left", 0, 1, settings, STEP) for _ in range(2))
    for n in range(100):
        assert (rests.look(see(1.0, 0.5)) is None) == (n < 20)
        assert moves.look(see(1.0, 0.51)) is None, "that is frozen, which another check is for"


def test_velocity_lag_in_hard_acceleration_faults_beyond_the_allowed_lag_only() -> None:
    """At 600 rad/s2 two periods of lag are 6 rad/s, and three are 9 rad/s: more than 6 and the tolerance."""
    late, too_late = velocity(), velocity()
    for n in range(100):
        t = n * STEP
        angle = 0.5 * 600.0 * t * t
        assert late.look(see(angle, 600.0 * (t - 2 * STEP))) is None
        told = too_late.look(see(angle, 600.0 * (t - 3 * STEP)))
        assert (told is None) == (n < 20)


def test_velocity_frozen_at_speed_faults_within_two_windows() -> None:
    check = velocity()
    angle, trip = 0.0, None
    for n in range(100):
        speed = 10.0 if n < 50 else 4.0
        angle += speed * STEP
        if check.look(see(angle, 10.0)) is not None and trip is None:
            trip = n
    assert trip is not None
    assert 50 <= trip <= 50 + 2 * 20


def test_values_that_stand_still_while_the_lines_change_are_no_sample() -> None:
    """At 30 rad/s 60 ms are 1.8 rad, which would be 18 rad/s of the window."""
    check = velocity()
    kept = (0.0, 30.0)
    for n in range(200):
        if not 100 <= n < 112:
            kept = (30.0 * n * STEP, 30.0)
        assert check.look(see(*kept)) is None
    assert [check.look(see(30.0 * 200 * STEP + n, 30.0 + 1e-6 * n)) for n in range(3)][2] is not None


def test_a_wheel_that_was_at_rest_for_long_and_sets_off_agrees() -> None:
    check, angle = velocity(), 0.0
    for n in range(2100):
        speed = max(20.0 * (n - 2000) * STEP, 0.0)
        angle += speed * STEP
        assert check.look(see(angle, speed)) is None


def test_a_cycle_that_starts_late_has_gone_as_far_as_the_time_says() -> None:
    check, angle = velocity(), 0.0
    for n in range(100):
        elapsed_s = 0.018 if n == 50 else STEP
        angle += 30.0 * elapsed_s
        assert check.look(see(angle, 30.0, elapsed_s=elapsed_s)) is None
    assert check.look(see(angle + 5.0, 30.0)) is not None


def test_samples_older_than_the_window_are_discarded() -> None:
    check = velocity()
    angle = 0.0
    told: list[bool] = []
    for n in range(200):
        off = 3.0 if 40 <= n < 45 else 0.0
        angle += (2.0 + off) * STEP
        told.append(check.look(see(angle, 2.0)) is not None)
    # 5 cycles of 3 rad/s in a window of 20 are a mean of 0.75: from the fourth of them to the second last in it.
    assert [n for n, is_told in enumerate(told) if is_told] == list(range(43, 61))


def test_a_rising_velocity_is_averaged_over_a_gap() -> None:
    check = velocity()
    for n in range(0, 400, 4):
        t = n * STEP
        assert check.look(see(0.5 * 60.0 * t * t, 60.0 * t, periods=4)) is None


def test_after_a_gap_the_window_is_the_shortest_that_is_long_enough() -> None:
    check = velocity()
    angle, told = 0.0, []
    for n in range(30):
        angle += 2.0 * STEP + (0.15 if n == 5 else 0.0)  # a slip of a mean of 1.5 rad/s over the window
        told.append(check.look(see(angle, 2.0)) is not None)
    assert told == [False] * 20 + [True] * 5 + [False] * 5
    for _ in range(2):
        angle += 2.0 * STEP * 20
        assert check.look(see(angle, 2.0, periods=20)) is None
    angle += 2.0 * STEP * 20 - 0.06  # 0.6 rad/s over the 20 periods of the gap, much less over all that is kept
    assert check.look(see(angle, 2.0, periods=20)) == "left.velocity is off by 0.60 rad/s from how left.angle changes"


def test_a_lost_wheel_begins_anew() -> None:
    check = velocity()
    for _ in range(30):
        check.look(see(1.0, 0.0))
    assert check.look(see(1.0, 0.0, valid=False)) is None
    for _ in range(30):
        assert check.look(see(90.0, 0.0)) is None
    assert check.needs == (0, 1)


def test_a_velocity_that_is_no_number_does_not_agree() -> None:
    check = velocity(0.01)
    assert [check.look(see(0.0, math.nan)) is None for _ in range(4)] == [True, True, False, False]


SUPPLY = RangeCheck("supply.voltage", 1, 20.0, 30.0, "V")


def look_at_supply(value: float, *, valid: bool = True) -> str | None:
    return SUPPLY.look(View((99.0, value), (True, valid), 1))


@pytest.mark.parametrize("value", [20.0, 25.0, 30.0])
def test_the_window_and_its_ends_are_allowed(value: float) -> None:
    assert look_at_supply(value) is None


def test_value_out_of_range_is_reported_with_the_range() -> None:
    assert look_at_supply(19.99) == "supply.voltage is 19.99 V, allowed is 20 to 30 V"
    assert look_at_supply(30.01) == "supply.voltage is 30.01 V, allowed is 20 to 30 V"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_outside(value: float) -> None:
    assert look_at_supply(value) is not None


def test_a_value_that_is_not_valid_is_not_looked_at() -> None:
    assert look_at_supply(99.0, valid=False) is None
    assert SUPPLY.needs == (1,)
