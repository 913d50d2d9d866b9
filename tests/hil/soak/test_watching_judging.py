# SPDX-License-Identifier: MIT
"""What counts as growth."""

import random

import pytest

from segway_ecc.hil.soak.watching import Series, judge, theil_sen


def series(values: list[float], *, allowed: float | None = 10.0, most: float | None = None) -> Series:
    times = [float(i) for i in range(len(values))]
    return Series(
        process="node", quantity="memory", unit="kB", allowed=allowed, most=most, times_s=times, values=values
    )


def test_what_is_level_does_not_grow_whatever_the_warm_up_did() -> None:
    verdict = judge(series([float(min(i, 20)) * 100 for i in range(101)]))
    assert (verdict.growth, verdict.is_growing, verdict.at_first, verdict.largest) == (0.0, False, 2000.0, 2000.0)


def test_a_slow_leak_is_growth() -> None:
    # After the warm-up 80 steps of 0.2 are left: 16.
    verdict = judge(series([100.0 + 0.2 * i for i in range(101)]))
    assert verdict.growth == pytest.approx(16.0)
    assert verdict.per_hour == pytest.approx(720.0)
    assert verdict.is_growing
    assert not judge(series([100.0 + 0.1 * i for i in range(101)])).is_growing


def test_a_leak_under_noise_with_outliers_is_found_and_noise_alone_is_not() -> None:
    chance = random.Random(3)  # noqa: S311 - chance that can be repeated
    noise = [chance.gauss(0.0, 3.0) + (500.0 if i % 9 == 0 else 0.0) for i in range(1000)]
    assert not judge(series(noise)).is_growing
    assert judge(series([n + 0.03 * i for i, n in enumerate(noise)])).is_growing


def test_one_large_step_in_the_last_quarter_is_growth_though_its_slope_is_none() -> None:
    values = [100.0] * 85 + [200.0] * 15
    assert theil_sen(range(100), values) == 0.0
    assert judge(series(values)).is_growing


def test_a_leak_that_is_given_back_in_the_end_is_growth_by_its_slope() -> None:
    values = [float(i) for i in range(85)] + [0.0] * 15
    assert judge(series(values)).growth > 10.0


def test_what_is_bounded_may_go_up_and_down_below_its_bound() -> None:
    saw = [float(i % 40) for i in range(200)]
    assert not judge(series(saw, most=40.0)).is_growing
    assert judge(series([*saw, 41.0], most=40.0)).is_growing
    assert judge(series([41.0, *saw], most=40.0)).is_growing


def test_what_is_not_judged_never_grows() -> None:
    assert not judge(series([float(i) ** 2 for i in range(100)], allowed=None)).is_growing


def test_too_few_samples_are_an_error() -> None:
    with pytest.raises(ValueError, match="7 samples of memory of node"):
        judge(series([1.0] * 9))


def test_the_median_slope_of_all_pairs() -> None:
    # Pairs: 1, 2, 5/3, 3, 2, 1; the median is (5/3 + 2) / 2.
    assert theil_sen([0, 1, 2, 3], [0, 1, 4, 5]) == pytest.approx((5 / 3 + 2) / 2)
    assert theil_sen([0, 0], [1, 2]) == 0.0
