# SPDX-License-Identifier: MIT
"""Which wheel counts while one spins, and when a robot has lost the floor."""

import math

import pytest

from segway_ecc.node.safety.spin import SpinWatch

PERIOD_S = 0.005
LONGEST = 20
"""A tenth of a second, in periods."""
BEFORE = 200
"""So long it must have been up: a second."""
LIFTED = "both wheels have lost the floor: the robot is lifted"


def watch_of_a_robot_that_is_up(
    periods: int = BEFORE, *, near: float = 0.4, period_s: float = PERIOD_S, longest: int = LONGEST
) -> SpinWatch:
    watch = SpinWatch(longest * period_s, near, period_s)
    for _ in range(periods):
        assert look(watch, 0.0, 0.0) == 0.0
    return watch


def look(  # noqa: PLR0913 - as the watch has them
    watch: SpinWatch,
    left: float,
    right: float,
    *,
    shown: float = 0.0,
    periods: int = 1,
    held: bool = True,
    idle: bool = False,
) -> float:
    return watch.look(left, right, shown, periods, balances=True, is_held=held, is_idle=idle)


def spins_for(watch: SpinWatch, left: float, right: float) -> int:
    """For how many periods it spins that has these speeds from now on."""
    for period in range(1000):
        look(watch, left, right)
        if not watch.is_on:
            return period
    raise AssertionError("it spins for ever")


def test_while_both_wheels_roll_the_axle_goes_as_fast_as_their_mean() -> None:
    watch = watch_of_a_robot_that_is_up()
    speed = 0.0
    for _ in range(50):
        speed += 0.22  # 44 m/s2
        assert look(watch, speed, 0.5 * speed, shown=3.0) == pytest.approx(0.75 * speed)
        assert not watch.is_on


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_while_one_wheel_spins_the_other_one_counts(side: int, way: float) -> None:
    watch = watch_of_a_robot_that_is_up()
    speeds = [0.1, 0.1]
    speeds[side] = way * 2.0
    assert look(watch, *speeds) == 0.1
    assert watch.is_on
    assert spins_for(watch, *speeds) == LONGEST - 2
    assert watch.fault is None


def test_a_wheel_that_is_back_ends_it() -> None:
    watch = watch_of_a_robot_that_is_up()
    look(watch, 2.0, 0.0)
    assert look(watch, 0.3, 0.1) == pytest.approx(0.2)
    assert (watch.is_on, watch.fault) == (False, None)


def turning(half: float, *, periods: int = 1) -> SpinWatch:
    """One of a robot that is up and has turned for a second: so fast does each wheel go, m/s, to either side."""
    watch = SpinWatch(LONGEST * PERIOD_S, 0.4, PERIOD_S)
    for _ in range(BEFORE // periods):
        assert look(watch, -half, half, periods=periods) == 0.0
    return watch


def test_while_the_robot_turns_and_a_wheel_spins_the_axle_goes_as_the_other_one_says() -> None:
    assert look(turning(0.3), -0.3, 2.3) == pytest.approx(0.0, abs=1e-3)
    assert look(turning(0.3), 2.3, 0.3) == pytest.approx(0.0, abs=1e-3)


def test_both_wheels_of_a_robot_that_is_lifted_as_it_turns_are_off() -> None:
    watch = turning(0.3)
    for _ in range(6):
        look(watch, 0.2, 0.8)
        assert watch.fault is None
    look(watch, 0.0, 0.0)
    assert watch.fault == LIFTED


@pytest.mark.parametrize("periods", [1, 4])
def test_a_turn_is_learnt_in_a_tenth_of_a_second(periods: int) -> None:
    watch = watch_of_a_robot_that_is_up()
    for _ in range(LONGEST // periods):
        look(watch, -0.2, 0.2, periods=periods)
    assert look(watch, -0.2, 2.0) == pytest.approx(-0.2 + 0.2 * {1: 0.6415, 4: 0.6723}[periods], abs=1e-4)


@pytest.mark.parametrize(("half", "axle"), [(0.999, 0.0), (1.0, 0.1)])
def test_wheels_that_differ_by_too_much_are_no_turn(half: float, axle: float) -> None:
    assert look(turning(half), -half, 3.0, shown=0.1) == pytest.approx(axle, abs=1e-3)


def test_where_both_are_off_the_imu_counts() -> None:
    watch = watch_of_a_robot_that_is_up()
    assert look(watch, 2.0, -2.0, shown=0.3) == 0.3
    spins_for(watch, 2.0, -2.0)
    assert watch.fault is None, "a robot in the air has both spin the same way"


@pytest.mark.parametrize(("periods", "fault"), [(5, None), (6, LIFTED)])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_both_that_spin_alike_for_30_ms_are_lifted_which_it_says_once_they_rest(
    way: float, periods: int, fault: str | None
) -> None:
    watch = watch_of_a_robot_that_is_up()
    for _ in range(periods):
        look(watch, way * 2.0, way * 1.5)
        assert watch.fault is None, "the wheels are braked meanwhile"
    look(watch, 0.0, 0.0)
    assert watch.fault == fault
    look(watch, 0.0, 0.0)
    assert watch.fault is None, "it is said once"


def test_wheels_of_a_lifted_robot_may_be_slow_before_they_rest() -> None:
    watch = watch_of_a_robot_that_is_up()
    for speed in (2.0,) * 6 + (1.0, 0.3, 0.2, 0.11):
        look(watch, speed, speed)
        assert (watch.is_on, watch.fault) == (True, None)
    look(watch, 0.09, 0.05)
    assert (watch.is_on, watch.fault) == (False, LIFTED)


@pytest.mark.parametrize(
    ("left", "right", "held"),
    [
        (2.0, 1.5, False),  # it leaps, and falls freely
        (2.0, 0.39, True),  # that one rolls
        (3.0, 0.5, True),  # not alike
        (2.0, -2.0, True),
    ],
)
def test_both_that_spin_otherwise_are_not_lifted(left: float, right: float, *, held: bool) -> None:
    watch = watch_of_a_robot_that_is_up()
    for _ in range(10):
        look(watch, left, right, held=held)
    look(watch, 0.0, 0.0)
    assert (watch.is_on, watch.fault) == (False, None)


def test_wheels_that_bounce_in_turns_are_not_lifted() -> None:
    watch = watch_of_a_robot_that_is_up()
    for place in range(18):
        look(watch, *((1.0, 1.4) if place % 2 else (1.4, 1.0)))
    look(watch, 0.0, 0.0)
    assert watch.fault is None


def test_wheels_that_turn_slower_than_a_body_that_was_struck_are_not_lifted() -> None:
    watch = watch_of_a_robot_that_is_up()
    look(watch, 0.3, 0.3, shown=1.0)
    for _ in range(10):
        look(watch, 0.31, 0.3, shown=1.0)
    look(watch, 0.0, 0.0)
    assert watch.fault is None


@pytest.mark.parametrize(
    ("gains", "shows", "lifted"),
    [
        ((0.07, 0.07), 0.0, True),
        ((-0.07, -0.07), 0.0, True),
        ((0.07, 0.05), 0.0, False),  # 10 m/s2 of one of them
        ((0.07, -0.07), 0.0, False),
        ((0.07, 0.07), 0.04, False),  # the robot gains it too
    ],
)
def test_both_that_gain_what_the_imu_does_not_feel_are_lifted_if_the_controller_has_given_up(
    gains: tuple[float, float], shows: float, *, lifted: bool
) -> None:
    watch = watch_of_a_robot_that_is_up()
    for place in range(1, 4):
        look(watch, place * gains[0], place * gains[1], shown=place * shows)
    found = []
    for _ in range(7):
        look(watch, 0.0, 0.0, shown=3.0 * shows, idle=True)
        found.append(watch.fault)
    assert not watch.is_on
    assert found == [None] * 3 + [LIFTED if lifted else None] + [None] * 3, "after 20 ms, and once"


@pytest.mark.parametrize(("waits", "idle", "speed"), [(97, True, 0.0), (0, False, 0.0), (0, True, 0.1)])
def test_they_are_not_where_it_gives_up_later_or_not_at_all_or_they_turn_on(
    waits: int, speed: float, *, idle: bool
) -> None:
    watch = watch_of_a_robot_that_is_up()
    for place in range(1, 4):
        look(watch, place * 0.07, place * 0.07)
    for _ in range(waits):
        look(watch, 0.2, 0.2)
    for _ in range(20):
        look(watch, speed, speed, idle=idle)
        assert watch.fault is None


def test_both_that_stay_off_are_lifted_once_the_time_is_over() -> None:
    watch = watch_of_a_robot_that_is_up()
    assert spins_for(watch, 2.0, 2.0) == LONGEST - 1
    assert watch.fault == LIFTED


def test_what_was_lifted_is_forgotten_where_no_wheel_is_credible() -> None:
    watch = watch_of_a_robot_that_is_up()
    for _ in range(8):
        look(watch, 2.0, 2.0)
    look(watch, 11.0, 11.0)
    assert (watch.is_on, watch.fault) == (False, None)
    look(watch, 0.0, 0.0)
    look(watch, 0.0, 0.0)
    assert watch.fault is None


def test_an_imu_that_fails_alone_begins_nothing() -> None:
    watch = watch_of_a_robot_that_is_up()
    assert look(watch, 0.1, 0.1, shown=50.0) == pytest.approx(0.1)
    assert not watch.is_on


def test_it_begins_only_once_the_robot_has_been_up_for_a_second() -> None:
    watch = watch_of_a_robot_that_is_up(BEFORE - 2)
    assert look(watch, 2.0, 0.0) == 1.0
    assert not watch.is_on
    watch.look(2.0, 0.0, 0.0, 1, balances=False, is_held=True, is_idle=False)
    for _ in range(BEFORE - 2):
        look(watch, 0.0, 0.0)
    look(watch, 1.0, 0.0)
    assert not watch.is_on
    look(watch, 2.0, 0.0)
    assert watch.is_on


def test_what_a_wheel_gains_over_several_periods_is_held_against_all_of_them() -> None:
    watch = watch_of_a_robot_that_is_up()
    look(watch, 0.6, 0.0, periods=3)
    assert not watch.is_on
    look(watch, 1.3, 0.0, periods=3)
    assert watch.is_on


@pytest.mark.parametrize(("apart", "adds_up"), [(100, True), (250, False)])
def test_spins_that_add_up_to_more_than_half_a_second_are_a_fault(apart: int, *, adds_up: bool) -> None:
    watch = watch_of_a_robot_that_is_up()
    faults = []
    for _ in range(6):
        look(watch, 2.0, 0.0)
        spins_for(watch, 2.0, 0.0)
        faults.append(watch.fault)
        for _ in range(apart):
            look(watch, 0.0, 0.0, shown=0.0)
    assert faults[:5] == [None] * 5
    assert (faults[5] == "wheels have no floor for more than 0.5 s in all") is adds_up


@pytest.mark.parametrize("speed", [11.0, -11.0, 1.7e308, math.inf, math.nan])
def test_what_no_wheel_does_counts(speed: float) -> None:
    watch = watch_of_a_robot_that_is_up()
    assert look(watch, speed, 0.0) == pytest.approx(0.5 * speed, nan_ok=True)
    assert not watch.is_on
    assert look(watch, 0.0, 0.0) == 0.0
    assert look(watch, 2.0, 0.0) == 0.0, "it was not learnt as a turn"


def test_nothing_spins_at_first() -> None:
    watch = SpinWatch(LONGEST * PERIOD_S, 0.4, PERIOD_S)
    assert (watch.is_on, watch.fault) == (False, None)


def test_it_forgets_what_was_as_it_begins_anew() -> None:
    watch = watch_of_a_robot_that_is_up()
    look(watch, 2.0, 2.0)
    watch.begin()
    for place in range(BEFORE - 1):
        assert look(watch, *((4.0, 4.0) if place % 2 else (2.0, 2.0))) in (2.0, 4.0)
        assert not watch.is_on
    look(watch, 4.0, 4.0)
    look(watch, 2.0, 2.0)
    assert watch.is_on


EXACT_S = 1.0 / 1024.0
"""A period in which gains of whole numbers, m/s2, are exact."""
SPINS = 45.0
UNFELT = 12.0
HARDLY = 20.0


def watch_of_exact_periods(near: float = 0.5) -> SpinWatch:
    return watch_of_a_robot_that_is_up(1024, near=near, period_s=EXACT_S, longest=102)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(("gain", "is_on"), [(SPINS, False), (SPINS + 0.125, True)])
@pytest.mark.parametrize("periods", [1, 3])
def test_a_wheel_spins_that_gains_more_than_45_m_s2(side: int, gain: float, periods: int, *, is_on: bool) -> None:
    watch = watch_of_exact_periods(near=1e-9)
    speeds = [0.0, 0.0]
    speeds[side] = gain * EXACT_S * periods
    look(watch, *speeds, periods=periods)
    assert watch.is_on is is_on


@pytest.mark.parametrize(
    ("gain", "share", "periods", "idle", "lifted"),
    [
        (UNFELT, 0.0, 15, 20, True),
        (UNFELT - 0.125, 0.0, 15, 20, False),
        (UNFELT, 0.5, 15, 20, True),
        (16.0, 0.53125, 15, 20, False),
        (UNFELT, 0.0, 14, 20, False),
        (UNFELT, 0.0, 15, 19, False),
    ],
)
@pytest.mark.parametrize("already", [0.0, 3.0])
def test_what_both_gain_and_the_imu_does_not_feel_has_limits(  # noqa: PLR0913 - each limit in turn
    gain: float, share: float, periods: int, idle: int, already: float, *, lifted: bool
) -> None:
    watch = watch_of_exact_periods()
    look(watch, 0.0, 0.0, shown=already)
    for place in range(1, periods + 1):
        speed = place * gain * EXACT_S
        look(watch, speed, speed, shown=already + share * speed)
    shown = already + share * speed
    look(watch, speed, speed, shown=shown)
    for _ in range(idle - 1):
        look(watch, 0.0, 0.0, shown=shown, idle=True)
    assert watch.fault is None
    assert look(watch, 0.0625, 0.03125, shown=shown, idle=True) == 0.046875 or not lifted
    assert watch.fault == (LIFTED if lifted else None)


@pytest.mark.parametrize(("gain", "lifted"), [(UNFELT, True), (UNFELT - 0.125, False)])
def test_what_both_gain_over_several_periods_is_held_against_all_of_them(gain: float, *, lifted: bool) -> None:
    watch = watch_of_exact_periods()
    for place in range(1, 6):
        speed = 3 * place * gain * EXACT_S
        look(watch, speed, speed, periods=3)
    for _ in range(7):
        look(watch, 0.0, 0.0, periods=3, idle=True)
    assert watch.fault == (LIFTED if lifted else None)


def test_gains_that_are_felt_in_between_do_not_add_up_to_unfelt_ones() -> None:
    watch = watch_of_exact_periods()
    speed = 0.0
    for place in range(29):
        speed += UNFELT * EXACT_S
        look(watch, speed, speed, shown=speed if place == 14 else 0.0)
    look(watch, speed, speed)
    for _ in range(30):
        look(watch, 0.0, 0.0, idle=True)
        assert watch.fault is None


@pytest.mark.parametrize("speeds", [(0.1, 0.0), (0.0, 0.1)])
def test_wheels_of_a_robot_that_gave_up_rest_both_before_it_is_lifted(speeds: tuple[float, float]) -> None:
    watch = watch_of_a_robot_that_is_up()
    for place in range(1, 4):
        look(watch, place * 0.07, place * 0.07)
    for _ in range(20):
        look(watch, *speeds, idle=True)
        assert watch.fault is None
    assert look(watch, 0.0, 0.0, idle=True) == 0.0
    assert watch.fault == LIFTED


@pytest.mark.parametrize("speeds", [(0.1, 0.0), (0.0, 0.1)])
def test_wheels_of_a_lifted_robot_rest_both_before_it_says_so(speeds: tuple[float, float]) -> None:
    watch = watch_of_a_robot_that_is_up()
    for _ in range(6):
        look(watch, 2.0, 2.0)
    look(watch, *speeds)
    assert (watch.is_on, watch.fault) == (True, None)


@pytest.mark.parametrize("speeds", [(10.0, 0.0), (0.0, 10.0)])
def test_no_wheel_goes_10_m_s(speeds: tuple[float, float]) -> None:
    watch = watch_of_a_robot_that_is_up()
    assert look(watch, *speeds) == 5.0
    assert not watch.is_on
    look(watch, 0.0, 0.0)
    look(watch, *(0.99 * speed for speed in speeds))
    assert watch.is_on


@pytest.mark.parametrize("side", [0, 1])
def test_a_wheel_rolls_that_is_near_to_the_imu(side: int) -> None:
    shown = 1.0
    for off, axle in ((0.25, 1.25), (-0.25, 0.75), (0.5, shown), (-0.5, shown)):
        speeds = [3.0, 3.0]
        speeds[side] = shown + off
        assert look(watch_of_exact_periods(), *speeds, shown=shown) == axle


@pytest.mark.parametrize("side", [0, 1])
def test_a_turn_is_taken_off_the_wheel_that_rolls(side: int) -> None:
    watch = turning(0.15)
    speeds = [2.0, 2.0]
    speeds[side] = 0.15 if side else -0.15
    assert look(watch, *speeds) == pytest.approx(0.0, abs=1e-4)
    assert watch.is_on


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (1.5, 0.39),  # that one rolls
        (0.39, 1.5),
        (5.0, 1.0),  # so far apart
        (1.0, 5.0),
    ],
)
def test_both_are_lifted_only_where_both_spin_alike(left: float, right: float) -> None:
    watch = watch_of_a_robot_that_is_up()
    for _ in range(10):
        look(watch, left, right)
    look(watch, 0.0, 0.0)
    assert watch.fault is None


@pytest.mark.parametrize(("left", "right"), [(3.0, 1.0), (1.0, 3.0)])
def test_both_spin_alike_up_to_four_fifths_of_the_faster(left: float, right: float) -> None:
    watch = watch_of_a_robot_that_is_up()
    for _ in range(6):
        look(watch, left, right)
    look(watch, 0.0, 0.0)
    assert watch.fault == LIFTED


@pytest.mark.parametrize(("left", "right"), [(0.0, 0.5), (0.5, 0.0)])
def test_a_wheel_that_stands_while_the_body_moves_does_not_spin(left: float, right: float) -> None:
    watch = watch_of_a_robot_that_is_up()
    look(watch, 2.0, 2.0, shown=-1.0)
    for _ in range(10):
        look(watch, left, right, shown=-1.0)
    look(watch, 0.0, 0.0)
    assert watch.fault is None


def test_what_spins_alike_in_turns_with_something_else_does_not_add_up() -> None:
    watch = watch_of_a_robot_that_is_up()
    for place in range(11):
        look(watch, 2.0, 2.0, held=place != 5)
    look(watch, 0.0, 0.0)
    assert watch.fault is None


@pytest.mark.parametrize(("gain", "lifted"), [(HARDLY - 0.5, True), (HARDLY, False)])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("periods", [1, 3])
def test_both_gain_alike_or_hardly_at_all(gain: float, side: int, periods: int, *, lifted: bool) -> None:
    watch = watch_of_exact_periods()
    for place in range(1 + -(-30 // periods)):
        speeds = [2.0, 2.0]
        speeds[side] += gain * EXACT_S * periods * (place % 2)
        look(watch, *speeds, periods=periods)
    look(watch, 0.0, 0.0)
    assert watch.fault == (LIFTED if lifted else None)


def test_a_spin_that_is_over_leaves_the_mean_of_both_wheels() -> None:
    watch = watch_of_a_robot_that_is_up()
    for _ in range(LONGEST - 1):
        assert look(watch, 2.0, 1.0) == 0.0
    assert look(watch, 2.0, 1.0) == 1.5
    assert not watch.is_on


@pytest.mark.parametrize(("apart", "adds_up"), [(BEFORE, False), (BEFORE - 1, True)])
def test_spins_a_second_apart_do_not_add_up(apart: int, *, adds_up: bool) -> None:
    watch = watch_of_a_robot_that_is_up()
    for _ in range(6):
        look(watch, 2.0, 0.0)
        spins_for(watch, 2.0, 0.0)
        fault = watch.fault
        for place in range(apart - 1):
            shown = 0.5 if place == 1 else 0.0  # both gain what the IMU shows: no spin
            look(watch, shown, shown, shown=shown)
    assert (fault is not None) is adds_up


def test_what_spins_as_the_robot_was_just_found_lifted_is_judged_by_itself() -> None:
    watch = watch_of_a_robot_that_is_up()
    for _ in range(6):
        look(watch, 2.0, 2.0)
    faults = []
    for speed in (0.0, 2.0, 0.0):
        look(watch, speed, 0.0)
        faults.append(watch.fault)
    assert faults == [LIFTED, None, None]
    assert not watch.is_on


@pytest.mark.parametrize(("periods", "was_on"), [(BEFORE - 1, True), (BEFORE, False)])
def test_a_spin_is_remembered_for_a_second(periods: int, *, was_on: bool) -> None:
    watch = watch_of_a_robot_that_is_up()
    shown = [watch.was_on]
    for speed in (2.0, 0.0):
        look(watch, speed, 0.0)
        shown.append(watch.was_on)
    assert (watch.is_on, shown) == (False, [False, True, True])
    for _ in range(periods):
        look(watch, 0.0, 0.0)
    assert watch.was_on is was_on


def test_one_that_begins_anew_remembers_no_spin() -> None:
    watch = watch_of_a_robot_that_is_up()
    look(watch, 2.0, 0.0)
    watch.begin()
    assert not watch.was_on


@pytest.mark.parametrize(("longest_s", "most_s"), [(0.1, 0.5), (0.25, 0.5), (0.3, 0.6), (0.5, 1.0)])
def test_spins_may_add_up_to_half_a_second_or_to_two_of_the_longest(longest_s: float, most_s: float) -> None:
    watch = SpinWatch(longest_s, 0.4, PERIOD_S)
    for _ in range(BEFORE):
        look(watch, 0.0, 0.0)
    faults = []
    for _ in range(round(most_s / longest_s) + 1):
        look(watch, 2.0, 0.0)
        spins_for(watch, 2.0, 0.0)
        faults.append(watch.fault)
        look(watch, 0.0, 0.0)
    assert faults[-1] == f"wheels have no floor for more than {most_s:g} s in all"
    assert set(faults[:-1]) == {None}
