# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.node.safety.rate import WINDOW_S, RateMeter, StillWatch

MS = 1_000_000
G = 9.80665
LEVEL = (0.0, 0.0, G)


def test_the_rate_is_known_after_a_second_s_cycles_and_not_before() -> None:
    meter = RateMeter(10 * MS)
    assert (meter.wanted_hz, WINDOW_S) == (100.0, 1.0)
    for n in range(100):
        meter.mark(n * 10 * MS)
        assert meter.rate_hz is None
    meter.mark(1000 * MS)
    assert meter.rate_hz == pytest.approx(100.0)


def test_the_rate_is_that_of_the_last_second_only() -> None:
    meter = RateMeter(10 * MS)
    for n in range(200):
        meter.mark(n * 20 * MS)
    assert meter.rate_hz == pytest.approx(50.0)
    for n in range(101):
        meter.mark((4000 + n * 10) * MS)
    assert meter.rate_hz == pytest.approx(100.0)


def test_a_step_of_seconds_and_a_clock_that_stands_still_give_a_rate() -> None:
    meter = RateMeter(3000 * MS)
    rates: list[float | None] = []
    for start_ms in (0, 4000, 4000):
        meter.mark(start_ms * MS)
        rates.append(meter.rate_hz)
    assert rates == [None, 0.25, 1e9]


def test_an_imu_is_still_for_as_long_as_it_neither_turns_nor_moves() -> None:
    still = StillWatch(0.1, 0.5)
    assert still.periods == 0
    still.look((0.06, 0.08, 0.0), LEVEL, 1)
    still.look((0.0, 0.0, 0.1), (0.0, 0.0, G + 0.49), 2)
    still.look((0.0, 0.0, 0.0), (0.0, 0.0, G - 0.49), 1)
    still.look((0.0, 0.0, 0.0), (G, 0.0, 0.0), 1)
    assert still.periods == 5


@pytest.mark.parametrize("gyro", [(0.11, 0.0, 0.0), (0.0, 0.0, -0.11), (0.07, 0.07, 0.07)])
def test_what_turns_is_not_still(gyro: tuple[float, float, float]) -> None:
    still = StillWatch(0.1, 0.5)
    still.look((0.0, 0.0, 0.0), LEVEL, 1)
    still.look(gyro, LEVEL, 1)
    assert still.periods == 0


@pytest.mark.parametrize("z", [G - 0.51, G + 0.51, 0.0])
def test_what_is_pushed_is_not_still(z: float) -> None:
    still = StillWatch(0.1, 0.5)
    still.look((0.0, 0.0, 0.0), LEVEL, 1)
    still.look((0.0, 0.0, 0.0), (0.0, 0.0, z), 1)
    assert still.periods == 0


def test_without_a_sample_it_begins_anew() -> None:
    still = StillWatch(0.1, 0.5)
    still.look((0.0, 0.0, 0.0), LEVEL, 7)
    still.interrupt()
    assert still.periods == 0


def test_what_turns_or_moves_by_just_as_much_as_is_allowed_is_still() -> None:
    """In free fall the acceleration is zero, which is exactly g from gravity."""
    still = StillWatch(0.5, G)
    still.look((0.0, 0.5, 0.0), (0.0, 0.0, 0.0), 3)
    assert still.periods == 3
