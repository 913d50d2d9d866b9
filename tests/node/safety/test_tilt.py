# SPDX-License-Identifier: MIT
"""Motions whose true tilt is known in closed form; g is 9.80665 m/s2 (CGPM 1901)."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.node.safety.check import View
from segway_ecc.node.safety.tilt import GRAVITY, StillWatch, TiltEstimate, TiltWatch

STEP = 0.005
G = 9.80665
STILL = (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, G)
FIRST = 20
"""Samples that the estimate begins with: those of 0.1 s."""


def leaning(pitch: float, magnitude: float = G) -> tuple[float, float, float]:
    """What an accelerometer at rest shows on a body that leans forward by `pitch`, REP-103."""
    return (-magnitude * math.sin(pitch), 0.0, magnitude * math.cos(pitch))


def begun(accelerometer: tuple[float, float, float]) -> TiltEstimate:
    estimate = TiltEstimate(STEP)
    for _ in range(FIRST):
        estimate.update(STILL, accelerometer, 1)
    return estimate


def settled(pitch: float) -> TiltEstimate:
    return begun(leaning(pitch))


def tilt_of(estimate: TiltEstimate) -> float:
    assert estimate.tilt is not None
    return estimate.tilt


def test_gravity_is_standard() -> None:
    assert GRAVITY == G


def test_tilt_is_unknown_before_a_tenth_of_a_second_of_samples_and_after_reset() -> None:
    estimate = TiltEstimate(STEP)
    for _ in range(FIRST - 1):
        estimate.update(STILL, leaning(0.3), 1)
        assert estimate.tilt is None
    estimate.reset()
    for _ in range(FIRST):
        assert estimate.tilt is None
        estimate.update((9.0, 9.0, 9.0), leaning(0.1), 1)
    assert estimate.tilt == pytest.approx(0.1)


@pytest.mark.parametrize("pitch", [-3.0, -1.0, -0.2, 0.0, 0.2, 1.0, 1.7, 3.0])
def test_the_first_samples_are_believed(pitch: float) -> None:
    assert tilt_of(settled(pitch)) == pytest.approx(abs(pitch))


@pytest.mark.parametrize("wrong", [1.35, -2.9])
@pytest.mark.parametrize("magnitude", [G, 9.0, 0.0, 3.0 * G])
def test_samples_that_are_wrong_at_the_start_do_not_reach_the_estimate(wrong: float, magnitude: float) -> None:
    """A first sample that was off by 1.35 rad took 6.9 s to be drawn to within 0.05 rad."""
    estimate = TiltEstimate(STEP)
    for _ in range(9):
        estimate.update(STILL, leaning(wrong, magnitude), 1)
    for _ in range(FIRST):
        estimate.update(STILL, leaning(0.02), 1)
    assert tilt_of(estimate) == pytest.approx(0.02, abs=1e-3)


def test_lying_on_the_side_is_a_tilt_too() -> None:
    assert tilt_of(begun((0.0, G, 0.0))) == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("rate", [-2.0, 2.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_gyro_turns_it_at_once_even_where_the_accelerometer_is_not_believed(rate: float, axis: int) -> None:
    estimate = settled(0.0)
    gyro = (rate, 0.0, 0.0) if axis == 0 else (0.0, rate, 0.0)
    for step in range(1, 101):
        estimate.update(gyro, (0.0, 0.0, 2.0 * G), 1)
        assert tilt_of(estimate) == pytest.approx(abs(rate) * STEP * step, abs=1e-3)


def test_accelerometer_corrects_roll_as_it_corrects_pitch() -> None:
    pitched, rolled = settled(0.0), settled(0.0)
    for _ in range(100):
        pitched.update(STILL, leaning(0.1), 1)
        rolled.update(STILL, (0.0, G * math.sin(0.1), G * math.cos(0.1)), 1)
    assert 0.02 < tilt_of(pitched) < 0.1
    assert tilt_of(rolled) == pytest.approx(tilt_of(pitched))


def test_it_leans_back_as_the_gyro_says() -> None:
    forward = settled(0.3)
    forward.update((0.0, -2.0, 0.0), (0.0, 0.0, 2.0 * G), 1)
    assert tilt_of(forward) == pytest.approx(0.29, abs=1e-4)
    sideways = begun((0.0, G * math.sin(0.3), G * math.cos(0.3)))  # rolled to the right by a turn about x
    sideways.update((-2.0, 0.0, 0.0), (0.0, 0.0, 2.0 * G), 1)
    assert tilt_of(sideways) == pytest.approx(0.29, abs=1e-4)


def test_a_turn_about_up_is_no_tilt_and_turns_the_lean_with_the_body() -> None:
    estimate = settled(0.0)
    for _ in range(200):
        estimate.update((0.0, 0.0, 3.0), (0.0, 0.0, 2.0 * G), 1)
    assert tilt_of(estimate) == pytest.approx(0.0, abs=1e-12)
    # Leaning forward by 0.3 and turned by a quarter about the body's own z: the lean is now about x.
    estimate = settled(0.3)
    for _ in range(1000):
        estimate.update((0.0, 0.0, math.pi / 2 / (1000 * STEP)), (0.0, 0.0, 2.0 * G), 1)
    estimate.update((2.0, 0.0, 0.0), (0.0, 0.0, 2.0 * G), 1)
    assert tilt_of(estimate) == pytest.approx(0.31, abs=1e-3)


def test_periods_that_passed_without_a_sample_are_made_up_for() -> None:
    estimate = settled(0.0)
    estimate.update((0.0, 1.0, 0.0), (0.0, 0.0, 2.0 * G), 4)
    assert tilt_of(estimate) == pytest.approx(0.02, abs=1e-4)


def test_the_accelerometer_draws_it_with_a_time_constant_of_two_seconds() -> None:
    estimate = settled(0.2)
    for _ in range(400):
        estimate.update(STILL, leaning(0.0), 1)
    assert tilt_of(estimate) == pytest.approx(0.2 * math.exp(-1.0), rel=0.01)


def test_a_gap_longer_than_the_time_constant_ends_at_the_accelerometer_and_not_beyond() -> None:
    estimate = settled(0.2)
    estimate.update(STILL, leaning(0.1), 4000)
    assert tilt_of(estimate) == pytest.approx(0.1)


@pytest.mark.parametrize(("magnitude", "believed"), [(0.89, False), (0.91, True), (1.09, True), (1.11, False)])
def test_the_accelerometer_is_believed_only_near_gravity(magnitude: float, believed: bool) -> None:  # noqa: FBT001 - a column of the table
    estimate = settled(0.2)
    for _ in range(100):
        estimate.update(STILL, leaning(0.0, magnitude * G), 1)
    assert (tilt_of(estimate) < 0.19) == believed
    assert believed or tilt_of(estimate) == pytest.approx(0.2)


def test_free_fall_shows_no_direction() -> None:
    assert begun((0.0, 0.0, 0.0)).tilt is None
    estimate = settled(0.2)
    estimate.update(STILL, (0.0, 0.0, 0.0), 1)
    assert estimate.tilt == pytest.approx(0.2)
    estimate = settled(0.0)
    estimate.update(STILL, leaning(0.5), 100)  # half a second: a quarter of the way, as vectors
    assert tilt_of(estimate) == pytest.approx(math.atan2(0.25 * math.sin(0.5), 0.75 + 0.25 * math.cos(0.5)))


def test_what_cancels_out_is_upright() -> None:
    estimate = settled(0.0)
    estimate.update(STILL, (0.0, 0.0, -G), 200)  # a second: half of the way
    assert estimate.tilt == 0.0
    estimate.update(STILL, leaning(0.5), 100)
    assert tilt_of(estimate) == pytest.approx(math.atan2(0.25 * math.sin(0.5), 0.75 + 0.25 * math.cos(0.5)))


@given(st.floats(-0.4, 0.4), st.floats(0.5, 3.0), st.floats(-0.02, 0.02))
def test_it_follows_a_swinging_body_with_a_biased_gyro(amplitude: float, frequency: float, bias: float) -> None:
    """A known swing, the accelerometer at the axle: within two hundredths and what the bias makes of it."""
    estimate = settled(0.0)
    for step in range(1, 1001):
        t = step * STEP
        rate = amplitude * frequency * math.cos(frequency * (t - STEP / 2))
        pitch = amplitude * math.sin(frequency * t)
        estimate.update((0.0, rate + bias, 0.0), leaning(pitch), 1)
        assert abs(tilt_of(estimate) - abs(pitch)) < 0.02 + 2.0 * abs(bias)


def view(gyro: tuple[float, ...], accelerometer: tuple[float, ...], *, valid: bool = True, periods: int = 1) -> View:
    return View((7.0, *gyro, *accelerometer), (True, valid, *(True,) * 5), periods)


def watch(tilt: float | None = None, rate: float | None = None, *, pitch: float | None = None) -> TiltWatch:
    """A watch; of a body that has lain at `pitch` for long enough."""
    checked = TiltWatch(range(1, 7), STEP, tilt, rate)
    for _ in range(FIRST - 1 if pitch is not None else 0):
        checked.look(view(STILL, leaning(pitch or 0.0)))
    return checked


def test_fall_faults_in_the_cycle_that_passes_the_limit() -> None:
    """The body falls as an inverted pendulum, from 0.01 rad by exp(4 t); the accelerometer is of no use meanwhile."""
    checked = watch(tilt=0.6, pitch=0.01)
    tripped = passed = None
    for step in range(400):
        t = step * STEP
        pitch, rate = 0.01 * math.exp(4.0 * t), 0.04 * math.exp(4.0 * t)
        if passed is None and pitch > 0.6:
            passed = step
        if checked.look(view((0.0, rate, 0.0), (0.0, 0.0, 1.3 * G) if step else leaning(pitch))) and tripped is None:
            tripped = step
    assert passed is not None
    assert tripped is not None
    assert passed - 2 <= tripped <= passed + 1


def test_tilt_and_rate_faults_name_their_limits() -> None:
    assert watch(tilt=0.5, pitch=0.61).look(view(STILL, leaning(0.61))) == "the body leans 0.61 rad, beyond 0.5 rad"
    assert watch(rate=3.0).look(view((3.0, 4.0, 9.0), leaning(0.0))) == "the body tilts at 5.00 rad/s, beyond 3 rad/s"


def test_within_or_without_limits_nothing_faults() -> None:
    assert watch(tilt=0.5, rate=3.0, pitch=0.49).look(view((2.1, 2.1, 99.0), leaning(0.49))) is None
    assert watch(rate=5.0, pitch=3.0).look(view((3.0, 4.0, 0.0), leaning(3.0))) is None
    assert watch(tilt=0.5, pitch=0.0).look(view((99.0, 99.0, 0.0), leaning(0.0))) is None
    limit = watch(tilt=math.pi / 2, pitch=-math.pi / 2)
    assert limit.look(view(STILL, (G, 0.0, 0.0))) is None, "the limit itself is allowed"


@pytest.mark.parametrize("gyro", [(math.nan, 0.0, 0.0), (0.0, math.nan, 0.0)])
def test_a_rate_that_is_no_number_is_beyond_every_limit(gyro: tuple[float, float, float]) -> None:
    assert watch(rate=3.0).look(view(gyro, leaning(0.0))) is not None
    checked = watch(tilt=3.1, pitch=0.0)
    checked.look(view(STILL, leaning(0.0)))
    assert checked.look(view(gyro, leaning(0.0))) is not None


def test_an_imu_that_is_not_valid_is_not_looked_at_and_begins_anew_after_a_tenth_of_a_second() -> None:
    checked = watch(tilt=0.5, pitch=0.4)
    checked.look(view(STILL, leaning(0.4)))
    for _ in range(FIRST):
        assert checked.look(view((0.0, 99.0, 0.0), leaning(3.0), valid=False)) is None
        assert checked.estimate.tilt == pytest.approx(0.4)
    assert checked.look(view((0.0, 99.0, 0.0), leaning(3.0), valid=False)) is None
    assert checked.estimate.tilt is None
    assert checked.needs == (1, 2, 3, 4, 5, 6)


def test_a_watch_makes_up_for_skipped_periods() -> None:
    checked = watch(tilt=0.5, pitch=0.0)
    checked.look(view(STILL, leaning(0.0)))
    checked.look(view((0.0, 1.0, 0.0), (0.0, 0.0, 2.0 * G), periods=10))
    assert checked.estimate.tilt == pytest.approx(0.05, abs=1e-3)


def test_a_watch_makes_up_for_a_gap_in_the_samples() -> None:
    checked = watch(tilt=0.5, pitch=0.0)
    checked.look(view(STILL, leaning(0.0)))
    for _ in range(9):
        checked.look(view(STILL, leaning(1.0), valid=False))
    checked.look(view((0.0, 1.0, 0.0), (0.0, 0.0, 2.0 * G)))
    assert checked.estimate.tilt == pytest.approx(0.05, abs=1e-3)
    checked.look(view((0.0, 1.0, 0.0), (0.0, 0.0, 2.0 * G)))
    assert checked.estimate.tilt == pytest.approx(0.055, abs=1e-3)


def sample(gyro: tuple[float, float, float], accelerometer: tuple[float, float, float], periods: int) -> View:
    return View((*gyro, *accelerometer), (True,) * 6, periods)


def test_an_imu_is_still_for_as_long_as_it_neither_turns_nor_moves() -> None:
    still = StillWatch(range(6), 0.1, 0.5)
    assert still.periods == 0
    still.look(sample((0.06, 0.08, 0.0), UPRIGHT, 1))
    still.look(sample((0.0, 0.0, 0.1), (0.0, 0.0, G + 0.49), 2))
    still.look(sample((0.0, 0.0, 0.0), (0.0, 0.0, G - 0.49), 1))
    still.look(sample((0.0, 0.0, 0.0), (G, 0.0, 0.0), 1))
    assert still.periods == 5


@pytest.mark.parametrize("gyro", [(0.11, 0.0, 0.0), (0.0, 0.0, -0.11), (0.07, 0.07, 0.07)])
def test_what_turns_is_not_still(gyro: tuple[float, float, float]) -> None:
    still = StillWatch(range(6), 0.1, 0.5)
    still.look(sample((0.0, 0.0, 0.0), UPRIGHT, 1))
    still.look(sample(gyro, UPRIGHT, 1))
    assert still.periods == 0


@pytest.mark.parametrize("z", [G - 0.51, G + 0.51, 0.0])
def test_what_is_pushed_is_not_still(z: float) -> None:
    still = StillWatch(range(6), 0.1, 0.5)
    still.look(sample((0.0, 0.0, 0.0), UPRIGHT, 1))
    still.look(sample((0.0, 0.0, 0.0), (0.0, 0.0, z), 1))
    assert still.periods == 0


def test_without_a_sample_it_begins_anew() -> None:
    still = StillWatch(range(6), 0.1, 0.5)
    still.look(sample((0.0, 0.0, 0.0), UPRIGHT, 7))
    still.look(View((*STILL, *UPRIGHT), (True,) * 5 + (False,), 1))
    assert still.periods == 0


def test_what_turns_or_moves_by_just_as_much_as_is_allowed_is_still() -> None:
    """In free fall the acceleration is zero, which is exactly g from gravity."""
    still = StillWatch(range(6), 0.5, G)
    still.look(sample((0.0, 0.5, 0.0), (0.0, 0.0, 0.0), 3))
    assert still.periods == 3
