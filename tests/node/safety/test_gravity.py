# SPDX-License-Identifier: MIT
"""What the IMU measures against gravity and the wheels: motion leaves no trace, noise and an offset of the gyro do."""

import math
import random
from collections.abc import Callable, Iterable, Iterator
from functools import partial

import pytest
from msgspec.structs import replace

from segway_ecc.node.safety.check import View
from segway_ecc.node.safety.gravity import GravityCheck
from segway_ecc.node.safety.settings import GravitySettings

PERIOD_S = 0.001
RADIUS, HEIGHT, G = 0.05, 0.5, 9.80665
SETTINGS = GravitySettings(wheel_radius=RADIUS, imu_height=HEIGHT, velocity_m_s=0.5, gyro_rad_s=0.05, settle_s=0.4)
STRICT = replace(SETTINGS, velocity_m_s=0.002, gyro_rad_s=0.002)
LONG = replace(SETTINGS, velocity_m_s=5.0, settle_s=1.0)
"""It holds for some seconds what it learnt."""
POLE = 1.0 / 0.4
Sample = tuple[float, float, float, float, float]
"""Velocities of both wheels, rad/s; gyro about y, rad/s; specific force along x and z, m/s2."""
REST: Sample = (0.0, 0.0, 0.0, 0.0, G)


def check_of(settings: GravitySettings = SETTINGS, period_s: float = PERIOD_S) -> GravityCheck:
    return GravityCheck((0, 1), (2, 3, 4), settings, period_s)


def looks(check: GravityCheck, samples: Iterable[Sample], periods: int = 1) -> Iterator[str | None]:
    return (check.look(View(sample, (True,) * 5, periods)) for sample in samples)


def first_fault(check: GravityCheck, samples: Iterable[Sample]) -> tuple[int, str]:
    return next((place, fault) for place, fault in enumerate(looks(check, samples)) if fault is not None)


def leaning(pitch: float) -> Sample:
    return 0.0, 0.0, 0.0, -G * math.sin(pitch), G * math.cos(pitch)


def moving(pitch: Callable[[float], float], way: Callable[[float], float], duration_s: float) -> Iterator[Sample]:
    """What a robot measures that leans and drives so over time, by central differences."""
    step = 1e-4

    def slope(value: Callable[[float], float], at: float) -> float:
        return (value(at + step) - value(at - step)) / (2.0 * step)

    def curve(value: Callable[[float], float], at: float) -> float:
        return (value(at + step) - 2.0 * value(at) + value(at - step)) / step**2

    for place in range(round(duration_s / PERIOD_S)):
        at = place * PERIOD_S
        middle = at - 0.5 * PERIOD_S  # an acceleration counts for the period that ends with its sample
        rate, sine, cosine = slope(pitch, at), math.sin(pitch(at)), math.cos(pitch(at))
        ahead = curve(lambda t: way(t) + HEIGHT * math.sin(pitch(t)), middle)
        up = curve(lambda t: HEIGHT * math.cos(pitch(t)), middle) + G
        wheel = slope(way, at) / RADIUS - rate
        yield wheel + 1.0, wheel - 1.0, rate, ahead * cosine - up * sine, ahead * sine + up * cosine


@pytest.mark.parametrize(
    ("pitch", "way"),
    [
        (lambda _: 0.0, lambda _: 0.0),
        (lambda _: 0.5, lambda _: 0.0),
        (lambda _: -0.4, lambda t: 0.4 * max(t - 0.3, 0.0) ** 2),
        (lambda t: 0.5 / (1.0 + math.exp(40.0 * (t - 0.5))), lambda t: 0.3 / (1.0 + math.exp(-30.0 * (t - 0.5)))),
        (lambda t: 0.1 * math.sin(7.0 * t), lambda t: 0.1 * math.sin(3.0 * t)),
    ],
    ids=["at rest", "on its stop", "speeding up", "standing up", "balancing"],
)
def test_motion_that_wheels_and_imu_both_show_is_no_fault(
    pitch: Callable[[float], float], way: Callable[[float], float]
) -> None:
    strict = replace(SETTINGS, velocity_m_s=0.012, gyro_rad_s=0.01)
    check = check_of(strict)
    assert set(looks(check, moving(pitch, way, 2.0))) == {None}
    assert check.is_credible


def test_a_check_that_has_seen_nothing_yet_has_nothing_against_the_imu() -> None:
    check = check_of()
    assert check.is_credible
    assert look_blind(check, 1) is None
    assert check.is_credible


def test_at_rest_nothing_is_off_wherever_it_leans() -> None:
    for pitch in (-1.0, -0.3, 0.0, 0.5, 1.2):
        assert set(looks(check_of(STRICT), [leaning(pitch)] * 3000)) == {None}


def test_both_wheels_count_by_half() -> None:
    for left, right in ((24.0, 0.0), (0.0, 24.0)):
        check = check_of()
        place, fault = first_fault(check, [REST, (left, right, 0.0, 0.0, G)])
        assert place == 1
        assert fault == (
            "the IMU does not measure how the robot moves: against gravity and the wheels it is off by 0.60 m/s, "
            "beyond 0.5 m/s"
        )


def test_the_limit_itself_is_no_fault_and_either_way_beyond_it_is() -> None:
    check = check_of(replace(SETTINGS, velocity_m_s=0.5, gyro_rad_s=1.0))
    assert list(looks(check, [REST, (10.0, 10.0, 0.0, 0.0, G)])) == [None, None]
    for wheel in (10.1, -10.1):
        assert first_fault(check_of(), [REST, (wheel, wheel, 0.0, 0.0, G)])[0] == 1


def test_an_imu_that_feels_nothing_is_a_fault_as_soon_as_a_fall_would_have_had_that_velocity() -> None:
    gain = 3.0 * POLE
    expected_s = -math.log(1.0 - SETTINGS.velocity_m_s * gain / G) / gain
    place, fault = first_fault(check_of(), [REST, *[(0.0,) * 5] * 1000])
    assert place * PERIOD_S == pytest.approx(expected_s, abs=1.5 * PERIOD_S)
    assert fault.startswith("the IMU does not measure how the robot moves")


@pytest.mark.parametrize("amount", [0.05, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0, 100.0])
def test_noise_of_any_size_is_a_fault_soon(amount: float) -> None:
    for seed in range(5):
        noise = partial(random.Random(seed).uniform, -amount, amount)  # noqa: S311 - noise, no secret
        samples: list[Sample] = [(0.0, 0.0, noise(), noise(), noise()) for _ in range(200)]
        place, _ = first_fault(check_of(), [REST] * 100 + samples)
        assert 100 <= place < 175


def test_an_accelerometer_ahead_that_jumps_is_off_by_its_integral() -> None:
    place, _ = first_fault(check_of(), [REST, *[(0.0, 0.0, 0.0, 30.0, G)] * 100])
    assert place == pytest.approx(0.5 / 30.0 / PERIOD_S, abs=2)


@pytest.mark.parametrize("offset", [0.06, -0.06, 0.3, -0.3])
def test_the_gyro_s_offset_is_learnt_with_three_equal_poles(offset: float) -> None:
    check = check_of(replace(SETTINGS, imu_height=-RADIUS))  # on the ground, where a rate alone moves nothing
    place, fault = first_fault(check, [REST] * 10 + [(0.0, 0.0, offset, 0.0, G)] * 4000)
    at = (place - 10) * PERIOD_S * POLE
    learnt = offset * (1.0 - math.exp(-at) * (1.0 + at + 0.5 * at * at))
    assert abs(learnt) == pytest.approx(0.05, rel=0.02)
    sign = "" if offset > 0.0 else "-"
    assert fault == f"the IMU's gyro is off by {sign}0.05 rad/s about y, beyond 0.05 rad/s"


def test_an_offset_below_the_limit_is_none_and_a_fault_lasts_as_long_as_the_offset() -> None:
    offset = (0.0, 0.0, 0.06, 0.0, G)
    assert set(looks(check_of(), [REST, *[(0.0, 0.0, 0.049, 0.0, G)] * 6000])) == {None}
    check = check_of()
    list(looks(check, [REST, *[offset] * 4000]))
    assert None not in set(looks(check, [offset] * 500))
    assert check.is_credible
    assert set(list(looks(check, [REST] * 4000))[1000:]) == {None}


def test_what_is_off_for_a_moment_is_learnt_as_a_quarter_of_a_metre_per_second_at_the_most() -> None:
    check = check_of(replace(SETTINGS, velocity_m_s=2.0, gyro_rad_s=0.12, settle_s=0.1), period_s=0.005)
    faults = list(looks(check, [REST, (30.0, 30.0, 0.0, 0.0, G)]))
    assert faults[1] == "the IMU's gyro is off by -0.13 rad/s about y, beyond 0.12 rad/s"
    check = check_of(replace(SETTINGS, velocity_m_s=2.0, gyro_rad_s=0.12, settle_s=0.1), period_s=0.005)
    faults = list(looks(check, [REST, (-30.0, -30.0, 0.0, 0.0, G)]))
    assert faults[1] == "the IMU's gyro is off by 0.13 rad/s about y, beyond 0.12 rad/s"


def test_the_gyro_is_taken_between_its_samples_and_swings_the_imu() -> None:
    check = check_of(replace(SETTINGS, velocity_m_s=0.54))
    assert list(looks(check, [REST, (0.0, 0.0, 1.0, 0.0, G)]))[1] is not None, "0.05 and 0.5 m/s"
    check = check_of(replace(SETTINGS, velocity_m_s=0.56))
    assert list(looks(check, [REST, (0.0, 0.0, 1.0, 0.0, G)])) == [None, None]


def test_it_begins_with_a_sample_near_gravity_in_motion_too() -> None:
    for x, z, credible in (
        (0.0, 1.11 * G, False),
        (0.0, 1.09 * G, True),
        (0.91 * G, 0.0, True),
        (0.0, 0.89 * G, False),
    ):
        check = check_of()
        assert list(looks(check, [(0.0, 0.0, 0.0, x, z)])) == [None]
        assert check.is_credible is credible
    check = check_of(replace(SETTINGS, velocity_m_s=0.02))
    pitch = 0.4
    samples = list(moving(lambda t: pitch + 0.8 * t, lambda t: 1.5 * t, 0.02))
    assert set(looks(check, samples)) == {None}


def test_while_it_has_not_begun_nothing_is_a_fault_and_nothing_is_credible() -> None:
    check = check_of()
    assert set(looks(check, [(0.0, 0.0, 50.0, 3.0, 3.0)] * 100)) == {None}
    assert not check.is_credible
    assert set(looks(check, [REST] * 100)) == {None}
    assert check.is_credible


def test_after_noise_it_begins_anew_and_forgets_what_it_learnt() -> None:
    check = check_of()
    list(looks(check, [REST, *[(0.0, 0.0, 0.3, 0.0, G)] * 2000]))
    place, _ = first_fault(check, [(20.0, 20.0, 0.3, 0.0, G)])
    assert place == 0
    assert not check.is_credible
    assert set(looks(check, [leaning(0.5)] * 4000)) == {None}
    assert check.is_credible


def test_an_imu_high_up_learns_as_its_equations_have_it() -> None:
    """Integrated here without the check's parts, as far as they are linear."""
    settings = replace(SETTINGS, imu_height=3.0, velocity_m_s=5.0, gyro_rad_s=0.05)
    given, height = 0.06, 3.0 + RADIUS
    ahead = pitch = learnt = 0.0
    expected = 0
    while learnt < 0.05:
        pitch += PERIOD_S * (given - learnt)
        ahead += PERIOD_S * G * pitch
        off = height * (given - learnt) - ahead
        ahead += PERIOD_S * 3.0 * POLE * off
        pitch += PERIOD_S * 3.0 * POLE**2 / G * off
        learnt -= PERIOD_S * POLE**3 / G * off
        expected += 1
    place, _ = first_fault(check_of(settings), [REST, *[(0.0, 0.0, given, 0.0, G)] * 20_000])
    assert place == pytest.approx(expected, rel=0.01)


def moved(speed: float, rate: float = 1e-3) -> Sample:
    """A motion ahead, m/s, of which the accelerometer shows nothing, and a rate that turns hardly anything, rad/s."""
    return speed / RADIUS, speed / RADIUS, rate, 0.0, G


def struck(speed: float) -> Sample:
    """The same, and it turns no more."""
    return moved(speed, 0.0)


def test_a_body_that_falls_onto_its_stop_is_no_fault_of_the_imu() -> None:
    check = check_of(replace(SETTINGS, velocity_m_s=0.2))
    fall = list(moving(lambda t: 0.05 * math.cosh(4.0 * t), lambda _: 0.0, 0.9))
    assert abs(fall[-1][2]) * HEIGHT > 1.0, "m/s, and none in the next sample"
    assert set(looks(check, [*fall, *[leaning(0.05 * math.cosh(4.0 * 0.9))] * 500])) == {None}
    assert check.is_credible


def landed_hard(check: GravityCheck) -> None:
    """Leave in it what a blow does."""
    list(looks(check, [REST] * 10))
    check._offset = -0.3
    assert (
        first_fault(check, [(0.0, 0.0, 1.0, 0.0, G)])[1]
        == "the IMU's gyro is off by -0.30 rad/s about y, beyond 0.05 rad/s"
    )


def faulty_for(check: GravityCheck, samples: Iterable[Sample]) -> int:
    """For how many samples there is a fault."""
    return sum(fault is not None for fault in looks(check, samples))


def test_what_a_hard_landing_left_is_forgotten_after_half_a_second_at_rest() -> None:
    check = check_of(LONG)
    landed_hard(check)
    assert faulty_for(check, [leaning(0.5)] * 3000) == 499
    assert check.is_credible
    assert check._offset == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "other",
    [
        (0.6, 0.0, 0.0, 0.0, G),
        (-0.6, 0.0, 0.0, 0.0, G),
        (0.0, 0.6, 0.0, 0.0, G),
        (0.0, -0.6, 0.0, 0.0, G),
        (0.0, 0.0, 0.06, 0.0, G),
        (0.0, 0.0, -0.06, 0.0, G),
        (0.0, 0.0, 0.0, 0.0, 1.11 * G),
        (0.0, 0.0, 0.0, 0.0, 0.89 * G),
    ],
)
def test_it_is_forgotten_only_of_a_body_that_rests_and_a_gyro_that_reads_so(other: Sample) -> None:
    check = check_of(LONG)
    landed_hard(check)
    assert faulty_for(check, [*[REST] * 400, other, *[REST] * 499]) == 900
    assert faulty_for(check, [REST] * 10) == 0


def test_rest_before_there_is_an_offset_does_not_count() -> None:
    check = check_of(LONG)
    assert set(looks(check, [REST] * 5000)) == {None}
    landed_hard(check)
    assert faulty_for(check, [REST] * 2000) == 499


def test_rest_is_counted_anew_once_there_is_no_offset_for_a_moment() -> None:
    check = check_of(LONG)
    landed_hard(check)
    assert faulty_for(check, [REST] * 400) == 400
    check._offset = 0.0
    assert faulty_for(check, [REST]) == 0
    check._offset = -0.3
    assert faulty_for(check, [REST] * 2000) == 499


def test_each_period_of_rest_counts() -> None:
    check = check_of(LONG)
    landed_hard(check)
    assert sum(fault is not None for fault in looks(check, [REST] * 400, periods=5)) == 99


def test_what_makes_the_body_turn_as_quickly_or_quicker_is_no_shock() -> None:
    for rate in (1e-3, -1e-3, 2e-3, -2e-3):
        check = check_of()
        assert set(looks(check, [moved(0.0)] * 600)) == {None}
        assert list(looks(check, [moved(0.6, rate)])) != [None]


def test_a_shock_is_passed_over_once_in_half_a_second() -> None:
    for calm, passed in ((498, False), (499, False), (500, True)):
        check = check_of()
        assert set(looks(check, [moved(0.0)] * 600)) == {None}
        assert list(looks(check, [struck(0.6)])) == [None]
        assert set(looks(check, [moved(0.6)] * calm)) == {None}
        assert (list(looks(check, [struck(0.0)])) == [None]) is passed


def test_the_first_shock_comes_half_a_second_after_the_beginning_at_the_earliest() -> None:
    for calm, passed in ((500, False), (501, True)):
        check = check_of()
        assert set(looks(check, [moved(0.0)] * calm)) == {None}
        assert (list(looks(check, [struck(0.6)])) == [None]) is passed
    check = check_of()
    assert set(looks(check, [moved(0.0)] * 167, periods=3)) == {None}
    assert list(looks(check, [struck(0.6)], periods=3)) == [None]


def test_a_shock_comes_in_one_sample() -> None:
    """Half of the limit at once, and more: what was off before is no shock."""
    for first, passed in ((0.24, True), (0.27, False)):
        check = check_of(replace(SETTINGS, settle_s=1e6, gyro_rad_s=1.0))
        assert set(looks(check, [moved(0.0)] * 600)) == {None}
        assert set(looks(check, [moved(first)] * 10)) == {None}
        assert (list(looks(check, [struck(0.51)])) == [None]) is passed


def test_what_was_off_before_a_gap_is_forgotten() -> None:
    check = check_of(replace(SETTINGS, settle_s=1e6, gyro_rad_s=1.0))
    list(looks(check, [moved(0.0)] * 600))
    list(looks(check, [moved(0.49)]))
    assert look_blind(check, 1) is None
    assert list(looks(check, [moved(0.49)])) == [None]
    assert list(looks(check, [struck(1.0)])) == [None], "a shock: nothing was off before"


def test_after_a_new_beginning_no_shock_is_passed_over_for_half_a_second() -> None:
    check = check_of()
    list(looks(check, [moved(0.0)] * 600))
    assert look_blind(check, 100) is None
    assert list(looks(check, [moved(0.0), moved(0.0)])) == [None, None]
    assert list(looks(check, [struck(0.6)])) != [None]


def test_one_gap_is_not_another() -> None:
    check = check_of()
    list(looks(check, [REST]))
    assert look_blind(check, 60) is None
    list(looks(check, [REST]))
    assert look_blind(check, 60) is None
    assert list(looks(check, [(30.0, 30.0, 0.0, 0.0, 3.0 * G)])) == [None]
    assert check.is_credible, "it goes on: it would not begin with such a sample"


def test_each_period_counts() -> None:
    gain = 3.0 * POLE
    one, three = check_of(), check_of()
    nothing = (0.0,) * 5
    assert list(looks(one, [REST, *[nothing] * 20])) == [None] * 21
    assert list(looks(three, [REST])) == [None]
    faults = list(looks(three, [nothing] * 40, periods=3))
    place = next(place for place, fault in enumerate(faults) if fault is not None)
    expected_s = -math.log(1.0 - SETTINGS.velocity_m_s * gain / G) / gain
    assert (place + 1) * 3 * PERIOD_S == pytest.approx(expected_s, abs=4 * PERIOD_S)


def look_blind(check: GravityCheck, periods: int, place: int = 4) -> str | None:
    valid = [True] * 5
    valid[place] = False
    return check.look(View((9.0, 9.0, 9.0, 9.0, 9.0), valid, periods))


@pytest.mark.parametrize("place", range(5))
def test_what_happens_in_a_gap_is_not_known(place: int) -> None:
    check = check_of()
    list(looks(check, [REST]))
    assert look_blind(check, 1, place) is None
    pushed = (30.0, 30.0, 0.0, 0.0, G)
    assert list(looks(check, [pushed] * 10)) == [None] * 10
    assert first_fault(check, [REST])[0] == 0


def test_after_a_gap_the_pitch_has_gone_on_with_the_gyro() -> None:
    check = check_of(STRICT)
    assert list(looks(check, [leaning(0.1)])) == [None]
    assert look_blind(check, 49) is None
    # On from 0.1 rad by the mean of 0 and 4 rad/s for 50 ms.
    assert list(looks(check, [(-4.0, -4.0, 4.0, *leaning(0.2)[3:])])) == [None]
    check._rate = 0.0  # it stops there
    turned = [(0.0, 0.0, 0.0, *leaning(0.2)[3:])] * 5
    assert look_blind(check, 1) is None
    assert list(looks(check, turned)) == [None] * 5


def test_after_a_long_gap_it_begins_anew() -> None:
    for periods, begins in ((99, False), (100, True)):
        check = check_of()
        list(looks(check, [REST]))
        assert look_blind(check, periods - 1) is None
        assert look_blind(check, 1) is None
        list(looks(check, [(0.0,) * 5]))
        assert check.is_credible is not begins


def test_a_late_cycle_that_saw_everything_is_looked_at_as_any_other() -> None:
    check = check_of()
    list(looks(check, [REST]))
    assert None not in list(looks(check, [(20.0, 20.0, 0.0, 0.0, G)], periods=3))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1.7e308])
@pytest.mark.parametrize("place", range(5))
def test_what_is_no_number_or_beyond_any_is_a_fault_and_forgotten(place: int, value: float) -> None:
    wrong = list(REST)
    wrong[place] = value
    check = check_of()
    faults = [check.look(View(values, (True,) * 5, 1)) for values in (REST, wrong, wrong, REST)]
    assert faults[0] is None
    assert faults[1] is not None
    assert set(looks(check, [REST] * 10)) == {None}
    assert check.is_credible
    check = check_of()
    for values in (wrong, REST, REST):
        check.look(View(values, (True,) * 5, 1))
    assert check.is_credible


def test_an_imu_beside_drives_that_measure_nothing_yet_is_judged_alone() -> None:
    check = check_of()
    unseen = (False, False, True, True, True)
    for sample, credible in ((REST, True), ((0.0, 0.0, 3.0, 12.0, -4.0), False), (REST, True), (leaning(0.5), True)):
        assert check.look(View(sample, unseen, 1)) is None
        assert check.is_credible is credible
    assert check.look(View((0.0,) * 5, (False,) * 5, 1)) is None
    assert check.is_credible, "what is not measured says nothing"


SPINNING = replace(SETTINGS, spin_s=0.1)
SPINS: Sample = (24.0, 0.0, 0.0, 0.0, G)
"""A wheel that turns so fast takes the axle's velocity 0.6 m/s off."""


def of_a_robot_that_is_up(settings: GravitySettings, sample: Sample = REST, periods: int = 1000) -> GravityCheck:
    check = check_of(settings)
    assert set(looks_up(check, [sample] * (periods + 1))) == {None}
    return check


def looks_up(check: GravityCheck, samples: Iterable[Sample]) -> Iterator[str | None]:
    return (check.look(View(sample, (True,) * 5, 1, balances=True)) for sample in samples)


@pytest.mark.parametrize("wheels", [(24.0, 0.0), (0.0, 24.0), (24.0, -24.0), (-24.0, 0.0)])
def test_a_wheel_that_spins_does_not_count_for_a_while_and_the_others_are_told(wheels: tuple[float, float]) -> None:
    check = of_a_robot_that_is_up(SPINNING)
    for _ in range(99):
        view = View((*wheels, 0.0, 0.0, G), (True,) * 5, 1, balances=True)
        assert check.look(view) is None
        assert view.spins
    view = View((24.0, 24.0, 0.0, 0.0, G), (True,) * 5, 1, balances=True)
    assert check.look(view) is not None
    assert not view.spins


@pytest.mark.parametrize(("share", "spins"), [(0.32, False), (0.345, True)])
def test_a_wheel_is_back_within_a_third_of_the_limit(share: float, *, spins: bool) -> None:
    check = of_a_robot_that_is_up(SPINNING)
    assert set(looks_up(check, [SPINS] * 5)) == {None}
    view = View((share * SPINNING.velocity_m_s / RADIUS, 0.0, 0.0, 0.0, G), (True,) * 5, 1, balances=True)
    assert check.look(view) is None
    assert view.spins is spins


@pytest.mark.parametrize(("settings", "periods"), [(SETTINGS, 1000), (SPINNING, 900)])
def test_it_counts_without_the_setting_and_for_a_robot_that_has_not_been_up_for_long(
    settings: GravitySettings, periods: int
) -> None:
    check = of_a_robot_that_is_up(settings, periods=periods)
    assert None not in list(looks_up(check, [SPINS]))


@pytest.mark.parametrize(
    ("wait", "reason"),
    [
        (0, "a wheel spun as without a floor, and the IMU does not show how the robot moves since: against gravity"),
        (1000, "the IMU does not measure how the robot moves: against gravity and the wheels it is off by"),
    ],
)
def test_the_reason_says_whether_a_wheel_lost_the_floor_before(wait: int, reason: str) -> None:
    check = of_a_robot_that_is_up(SPINNING)
    assert set(looks_up(check, [SPINS] * 5 + [REST] * (wait + 1))) == {None}
    fault = check.look(View(SPINS, (True,) * 5, 1))
    assert fault is not None
    assert fault.startswith(reason)


def test_the_other_wheel_of_a_body_that_turns_shows_how_the_axle_moves() -> None:
    swing = list(moving(lambda t: 0.1 * math.sin(5.0 * t), lambda _: 0.0, 1.3))
    for step in range(1246, 1267):  # as it turns fastest, by 0.5 rad/s
        left, right, rate, x, z = swing[step]
        swing[step] = (left + 24.0, right, rate, x, z)
    assert set(looks_up(check_of(SPINNING), swing)) == {None}


def test_after_a_gap_a_robot_has_not_been_up_for_long() -> None:
    check = of_a_robot_that_is_up(SPINNING)
    for _ in range(500):
        assert check.look(View(REST, (False,) * 5, 1, balances=True)) is None
    assert set(looks_up(check, [REST] * 900)) == {None}
    assert None not in list(looks_up(check, [SPINS]))


def test_nothing_is_learnt_while_a_wheel_spins() -> None:
    check = of_a_robot_that_is_up(SPINNING)
    off = (24.0, 3.0, 0.0, 0.0, G)  # 0.15 m/s, of which it would learn
    assert set(looks_up(check, [off] * 90)) == {None}
    assert check._offset == 0.0


@pytest.mark.parametrize(
    ("share", "lifted"),
    [(0.49, False), (0.51, True), (1.0, True), (1.99, True), (2.01, False)],  # it falls freely, or was struck
)
def test_a_robot_that_was_lifted_is_told_once_and_taken_as_it_is_then(share: float, *, lifted: bool) -> None:
    check = of_a_robot_that_is_up(SPINNING)
    spins = (24.0, 24.0, 0.0, 0.0, share * G)
    assert set(looks_up(check, [spins] * 31)) == {None}
    found = list(looks_up(check, [REST] * 100))
    assert (found[0] == "both wheels have lost the floor: the robot is lifted") is lifted
    assert set(found[1:]) == {None}
    assert check.is_credible


def test_the_wheels_of_a_robot_that_leans_far_count_always() -> None:
    for lean, counts in ((0.39, False), (0.41, True)):
        check = of_a_robot_that_is_up(SPINNING, leaning(lean))
        (fault,) = looks_up(check, [(24.0, 0.0, *leaning(lean)[2:])])
        assert (fault is not None) is counts
