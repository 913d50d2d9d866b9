# SPDX-License-Identifier: MIT
"""The segway's sensors: steps, noise, bias, latency, and accelerations against a path differentiated by numbers."""

import dataclasses
import itertools
import math
import statistics
from collections.abc import Iterable, Sequence

import pytest

from segway_ecc.hil.plants.segway_body import SegwayBody
from segway_ecc.hil.plants.segway_hardware import MOST_STEPS, Encoder, Imu, ImuErrors
from segway_ecc.node.models.segway_parameters import PUBLISHED

H = 0.0025
COUNT = 2 * math.pi / 16384
G, HEIGHT = 9.80665, 0.507
NONE = ImuErrors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, G)


def sample(encoder: Encoder, angle: float, velocity: float) -> None:
    encoder.follow(angle, velocity, angle, velocity, 1)


def test_angles_come_in_whole_counts() -> None:
    encoder = Encoder(PUBLISHED, H, 0.0)
    for angle in (0.1, 0.10001, -0.1, 7.0):
        sample(encoder, angle, 0.0)
        assert encoder.angle / COUNT == pytest.approx(round(encoder.angle / COUNT), abs=1e-6)
        assert 0.0 <= angle - encoder.angle < COUNT


def test_less_than_a_count_does_not_show() -> None:
    encoder = Encoder(PUBLISHED, H, 0.25 * COUNT)
    sample(encoder, 0.75 * COUNT, 0.5 * COUNT / H)
    assert (encoder.angle, encoder.velocity) == (0.0, 0.0)


def test_velocity_is_filtered_differences() -> None:
    """A step of three counts through step / (step + time): 0.0025 / 0.0075."""
    encoder = Encoder(PUBLISHED, H, 0.0)
    sample(encoder, 3.5 * COUNT, 0.0)
    assert encoder.velocity == pytest.approx(3 * COUNT / H / 3)
    sample(encoder, 3.5 * COUNT, 0.0)
    assert encoder.velocity == pytest.approx(3 * COUNT / H / 3 * 2 / 3)


def test_velocity_settles_at_the_true_one() -> None:
    encoder = Encoder(PUBLISHED, H, 0.0)
    seen = []
    for i in range(400):
        sample(encoder, 5.0 * H * i, 5.0)
        seen.append(encoder.velocity)
    assert statistics.fmean(seen[100:]) == pytest.approx(5.0, rel=1e-3)
    assert 0.0 < max(seen[100:]) - min(seen[100:]) < COUNT / H


def test_an_encoder_without_counts_measures_the_truth() -> None:
    encoder = Encoder(dataclasses.replace(PUBLISHED, encoder_counts_per_turn=0.0), H, 0.1)
    assert encoder.angle == 0.1
    sample(encoder, 0.123456, 7.0)
    assert (encoder.angle, encoder.velocity) == (0.123456, 7.0)


def test_at_rest_it_feels_the_ground_that_carries_it() -> None:
    """Leaning forward by 30 degrees: ahead points half down, so half of g pushes back along it."""
    lean = math.radians(30.0)
    felt = _measured(pitch=lean)
    assert felt == pytest.approx((0.0, 0.0, 0.0, -G / 2, 0.0, G * math.sqrt(3) / 2))


def test_on_a_slope_gravity_stays_upright() -> None:
    felt = _measured(slope=0.2)
    assert felt == pytest.approx(STILL)


def test_turning_upright_it_turns_about_its_own_axis_and_feels_the_curve() -> None:
    felt = _measured(v=1.5, w=2.0)
    assert felt == pytest.approx((0.0, 0.0, 2.0, 0.0, 3.0, G))


def test_measures_the_motion_of_its_path() -> None:
    """Accelerations from where the IMU was, angular velocity from how it was turned, one step before and after."""
    body = SegwayBody(dataclasses.replace(PUBLISHED, stop_angle=1e3, coulomb_friction=0.0))
    body.v, body.w, body.pitch = 0.8, 2.5, 0.3
    tiny, places, frames, felt = 1e-4, [], [], []
    x = y = 0.0
    for _ in range(3000):
        heading = body.heading
        way, turn = body.step(tiny, 0.3, 0.9)
        x, y = x + way * math.cos(heading + turn / 2), y + way * math.sin(heading + turn / 2)
        frames.append(_axes(body.heading, body.pitch))
        places.append([at + HEIGHT * up for at, up in zip((x, y, 0.0), frames[-1][2], strict=True)])
        felt.append(body.measured_motion(HEIGHT))
    for i in range(100, 2900, 100):
        before, now, after = places[i - 1 : i + 2]
        acceleration = [(a - 2 * b + c) / tiny**2 for a, b, c in zip(before, now, after, strict=True)]
        force = [
            sum(p * q for p, q in zip(axis, (*acceleration[:2], acceleration[2] + G), strict=True))
            for axis in frames[i]
        ]
        assert felt[i][3:] == pytest.approx(force, abs=0.01)
        assert felt[i][:3] == pytest.approx(_turning(frames[i - 1], frames[i], frames[i + 1], tiny), abs=1e-4)


def _measured(*, v: float = 0.0, w: float = 0.0, pitch: float = 0.0, slope: float = 0.0) -> Sequence[float]:
    body = SegwayBody(PUBLISHED)
    body.v, body.w, body.pitch = v, w, pitch
    body.tilt(slope)
    return body.measured_motion(HEIGHT)


def _axes(heading: float, pitch: float) -> list[list[float]]:
    """The body's x, y and z in the ground's."""
    ch, sh, cp, sp = math.cos(heading), math.sin(heading), math.cos(pitch), math.sin(pitch)
    return [[ch * cp, sh * cp, -sp], [-sh, ch, 0.0], [ch * sp, sh * sp, cp]]


def _turning(
    before: Sequence[Sequence[float]], now: Sequence[Sequence[float]], after: Sequence[Sequence[float]], tiny: float
) -> list[float]:
    """About x: how fast y moves towards z; and so round."""
    rates = [[(b - a) / (2 * tiny) for a, b in zip(p, q, strict=True)] for p, q in zip(before, after, strict=True)]
    return [sum(p * q for p, q in zip(rates[(i + 1) % 3], now[(i + 2) % 3], strict=True)) for i in range(3)]


def _seen(imu: Imu, motions: Iterable[Sequence[float]]) -> list[Sequence[float]]:
    """What an IMU shows at each step after it has taken one motion a step."""
    shown = []
    for step, motion in enumerate(motions, 1):
        imu.add_sample(step, motion)
        shown.append(imu.show(step))
    return shown


def _samples(errors: ImuErrors, seed: int, count: int = 20_000) -> list[Sequence[float]]:
    return _seen(Imu(errors, H, seed, STILL), itertools.repeat(STILL, count))


def test_noise_has_the_spread_of_its_density() -> None:
    """A density over 100 Hz: ten times its number."""
    errors = dataclasses.replace(NONE, gyro_noise=2e-4, accelerometer_noise=3e-3)
    for axis, expected in enumerate((2e-3, 2e-3, 2e-3, 3e-2, 3e-2, 3e-2)):
        values = [sample[axis] for sample in _samples(errors, 7)]
        assert statistics.stdev(values) == pytest.approx(expected, rel=0.03)
        assert statistics.fmean(values) == pytest.approx(STILL[axis], abs=5 * expected / math.sqrt(len(values)))


def test_at_a_low_rate_half_of_it_is_the_bandwidth() -> None:
    imu = Imu(dataclasses.replace(NONE, gyro_noise=1e-3), 1 / 50, 7, STILL)
    values = [sample[0] for sample in _seen(imu, itertools.repeat(STILL, 20_000))]
    assert statistics.stdev(values) == pytest.approx(5e-3, rel=0.03)


def test_noise_is_as_large_and_as_white_where_only_some_steps_are_asked_for() -> None:
    imu = Imu(dataclasses.replace(NONE, gyro_noise=2e-4), H, 7, STILL)
    values = []
    for step in range(0, 100_000, 5):
        imu.add_sample(step, STILL)
        values.append(imu.show(step)[1])
    assert statistics.stdev(values) == pytest.approx(2e-3, rel=0.03)
    assert abs(statistics.correlation(values[1:], values[:-1])) < 0.03


def test_noise_is_normally_distributed() -> None:
    """Shares within one, two and three standard deviations."""
    values = [abs(x) / 2e-3 for s in _samples(dataclasses.replace(NONE, gyro_noise=2e-4), 9) for x in s[:3]]
    shares = [sum(value < bound for value in values) / len(values) for bound in (1.0, 2.0, 3.0)]
    assert shares == pytest.approx([0.6827, 0.9545, 0.9973], abs=0.005)


def test_axes_are_independent() -> None:
    samples = _samples(dataclasses.replace(NONE, gyro_noise=1e-3, accelerometer_noise=1e-3), 3)
    for one, other in itertools.combinations(range(6), 2):
        assert abs(statistics.correlation([s[one] for s in samples], [s[other] for s in samples])) < 0.03


def test_bias_and_scale_are_drawn_once_with_their_spread() -> None:
    errors = dataclasses.replace(NONE, gyro_bias=0.01, accelerometer_scale=0.02)
    drawn = [_samples(errors, seed, 1)[0] for seed in range(2000)]
    assert statistics.stdev(sample[1] for sample in drawn) == pytest.approx(0.01, rel=0.06)
    assert statistics.stdev(sample[5] / G for sample in drawn) == pytest.approx(0.02, rel=0.06)
    assert all(sample[3] == 0.0 for sample in drawn)
    first, second = _samples(errors, 5, 2)
    assert first == second


def test_the_same_seed_gives_the_same_run() -> None:
    assert _samples(ImuErrors(), 4, 50) == _samples(ImuErrors(), 4, 50)
    assert _samples(ImuErrors(), 4, 50) != _samples(ImuErrors(), 5, 50)


@pytest.mark.parametrize(("latency", "steps"), [(0.0, 0), (0.001, 0), (0.0025, 1), (0.01, 4)])
def test_samples_come_late(latency: float, steps: int) -> None:
    imu = Imu(dataclasses.replace(NONE, latency=latency), H, 1, STILL)
    seen = [shown[0] for shown in _seen(imu, ((float(i), 0.0, 0.0, 0.0, 0.0, 0.0) for i in range(1, 10)))]
    assert imu.delay == steps
    assert seen == [0.0] * steps + [float(i) for i in range(1, 10 - steps)]


def test_shows_the_newest_that_has_arrived_until_another_does() -> None:
    imu = Imu(dataclasses.replace(ImuErrors(), latency=2 * H), H, 1, STILL)
    for step in (3, 4, 8):
        imu.add_sample(step, (float(step), 0.0, 0.0, 0.0, 0.0, 0.0))
    shown = {step: imu.show(step) for step in (4, 6, 7, 9, 10)}
    assert [round(shown[step][0]) for step in (4, 6, 7, 9, 10)] == [0, 4, 4, 4, 8]
    assert shown[6] == shown[7] == shown[9]  # one sample, one noise


@pytest.mark.parametrize("latency", [0.0, 2 * H])
@pytest.mark.parametrize("looks_every", [2, 5])
def test_what_nobody_looks_at_changes_nothing_of_the_rest(latency: float, looks_every: int) -> None:
    errors = dataclasses.replace(ImuErrors(), latency=latency)
    one, other = Imu(errors, H, 3, STILL), Imu(errors, H, 3, STILL)
    for step in range(1, 40):
        sample = (float(step), 0.0, 0.0, 0.0, 0.0, 0.0)
        for imu in (one, other):
            if step % 3:  # some are missing
                imu.add_sample(step, sample)
        shown = one.show(step)
        if step % looks_every:
            other.pass_over(step)
        else:
            assert other.show(step) == shown


def test_a_sample_that_nobody_looks_at_is_not_worked_out() -> None:
    asked: list[object] = []

    def motion_of(sample: object) -> Sequence[float]:
        asked.append(sample)
        return STILL

    imu = Imu(dataclasses.replace(ImuErrors(), latency=0.0), H, 1, "first", motion_of)
    for step in range(1, 4):
        imu.add_sample(step, step)
        imu.pass_over(step)
    imu.show(3)
    imu.show(3)
    assert asked == ["first", 3]


@pytest.mark.parametrize("steps", range(1, MOST_STEPS + 1))
def test_an_encoder_follows_a_cubic_way_as_if_sampled_at_each_step(steps: int) -> None:
    """Hermite interpolation is exact for polynomials of third degree."""

    def way(t: float) -> float:
        return 0.3 - 4.0 * t + 900.0 * t**2 - 60_000.0 * t**3

    def speed(t: float) -> float:
        return -4.0 + 1800.0 * t - 180_000.0 * t**2

    followed, sampled = Encoder(PUBLISHED, H, 0.3), Encoder(PUBLISHED, H, 0.3)
    for start in range(0, 12, steps):
        end = start + steps
        followed.follow(way(start * H), speed(start * H), way(end * H), speed(end * H), steps)
        for step in range(start + 1, end + 1):
            sample(sampled, way(step * H), speed(step * H))
        assert followed.angle == sampled.angle
        assert followed.velocity == pytest.approx(sampled.velocity, rel=1e-9)
    assert abs(sampled.velocity) > 10.0
