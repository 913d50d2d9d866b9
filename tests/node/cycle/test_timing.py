# SPDX-License-Identifier: MIT
import math
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from segway_ecc.node.cycle.timing import Histogram, Summary, Tally

LARGEST = (1 << 40) - 1
durations = st.one_of(st.integers(0, 200), st.integers(0, 10**8), st.integers(0, LARGEST))


def histogram(samples: list[int]) -> Histogram:
    filled = Histogram()
    for sample in samples:
        filled.add(sample)
    return filled


# Fractions of 64 are exact in binary, so that the rank is the same in both arithmetics.
@settings(derandomize=True)
@given(st.lists(durations, min_size=1, max_size=200), st.integers(1, 64))
def test_a_percentile_is_at_most_a_thirty_second_above_that_of_the_sorted_samples(
    samples: list[int], sixty_fourths: int
) -> None:
    exact = sorted(samples)[math.ceil(Fraction(sixty_fourths, 64) * len(samples)) - 1]
    found = round(histogram(samples).percentile_s(sixty_fourths / 64) * 1e9)
    assert exact <= found <= exact * 33 / 32


@settings(derandomize=True)
@given(st.lists(durations, min_size=1, max_size=50))
def test_count_mean_and_largest_are_exact(samples: list[int]) -> None:
    summary = histogram(samples).summary()
    assert summary.count == len(samples)
    assert summary.mean_s == pytest.approx(float(Fraction(sum(samples), len(samples) * 10**9)), rel=1e-14, abs=0.0)
    assert round(summary.max_s * 1e9) == max(samples)
    assert summary.p50_s <= summary.p99_s <= summary.p999_s <= summary.max_s


def test_up_to_63_ns_every_percentile_is_exact() -> None:
    filled = histogram(list(range(64)))
    assert [round(filled.percentile_s((n + 1) / 64) * 1e9) for n in range(64)] == list(range(64))


def test_a_percentile_is_the_longest_that_its_bucket_holds() -> None:
    # From 64 ns on two lengths share a bucket, from 128 ns on four.
    assert round(histogram([64, 1000]).percentile_s(0.5) * 1e9) == 65
    assert round(histogram([129, 1000]).percentile_s(0.5) * 1e9) == 131


def test_the_summary_holds_the_three_percentiles() -> None:
    # 1000 samples: 500 of 10 ns, 490 of 20 ns, 9 of 30 ns and 1 of 40 ns.
    summary = histogram([10] * 500 + [20] * 490 + [30] * 9 + [40]).summary()
    assert [round(s * 1e9) for s in (summary.p50_s, summary.p99_s, summary.p999_s, summary.max_s)] == [10, 20, 30, 40]


def test_an_empty_histogram_is_all_zero() -> None:
    assert Histogram().summary() == Summary(0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_negative_duration_counts_as_zero() -> None:
    assert histogram([-5]).summary() == Summary(1, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_what_is_longer_than_the_last_bucket_is_still_counted_and_its_length_kept() -> None:
    summary = histogram([10, 1 << 50]).summary()
    assert summary.count == 2
    assert round(summary.max_s * 1e9) == 1 << 50
    assert summary.p99_s > 1000.0


def test_the_text_is_in_microseconds() -> None:
    text = Summary(3, 1e-6, 1.26e-6, 2e-5, 3e-4, 0.004).as_text()
    assert text == "p50 1.3 us, p99 20.0 us, p99.9 300.0 us, max 4000.0 us"


@pytest.mark.parametrize("cycles", [0, 1, 31, 32, 33, 100])
def test_a_tally_holds_each_duration_under_its_name_whenever_it_is_asked(cycles: int) -> None:
    tally = Tally(("exchange", "cycle"))
    for cycle in range(cycles):
        tally.note((cycle, 1000 + cycle))
        if cycle % 7 == 0:
            assert tally.histograms["cycle"].summary().count == cycle + 1
    found = {name: each.summary() for name, each in tally.histograms.items()}
    assert [summary.count for summary in found.values()] == [cycles, cycles]
    if cycles:
        assert found["exchange"].max_s == pytest.approx((cycles - 1) * 1e-9)
        assert found["cycle"].max_s == pytest.approx((999 + cycles) * 1e-9)
