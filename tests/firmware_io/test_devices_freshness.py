# SPDX-License-Identifier: MIT
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.devices import PATIENCE_PERIODS, STALE_PERIODS, SUPPLY_STALE_NS, Freshness, stale_after_ns

MS = 1_000_000


class Bench:
    """Two kinds of frame, stale after 10 and 20 ms, on a manual clock."""

    def __init__(self) -> None:
        self.now_ns = 5_000 * MS
        self.fresh = Freshness({"fast": 10 * MS, "slow": 20 * MS}, lambda: self.now_ns)


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.mark.parametrize(
    ("frame_period_s", "loop_period_s", "expected_ns"),
    [
        (0.005, 0.001, 15 * MS),
        (0.005, 0.005, 15 * MS),
        (0.005, 0.010, 30 * MS),
        (0.020, 0.010, 60 * MS),
        (0.0, 1 / 3, 1_000 * MS),
    ],
)
def test_stale_is_three_periods_of_the_slower_of_frame_and_loop(
    frame_period_s: float, loop_period_s: float, expected_ns: int
) -> None:
    assert STALE_PERIODS == 3
    assert stale_after_ns(frame_period_s, loop_period_s) == expected_ns


def test_before_the_first_frame_a_kind_is_infinitely_old_and_not_fresh(bench: Bench) -> None:
    assert bench.fresh.age("fast") == (math.inf, False)
    assert bench.fresh.newest_ns is None


def test_a_kind_is_as_old_as_its_newest_frame(bench: Bench) -> None:
    bench.fresh.mark("fast", bench.now_ns - 9 * MS)
    bench.fresh.mark("fast", bench.now_ns - 3 * MS)
    assert bench.fresh.age("fast") == pytest.approx((0.003, True))


def test_what_a_frame_carries_beside_may_be_older(bench: Bench) -> None:
    assert SUPPLY_STALE_NS == 1_000 * MS
    assert bench.fresh.age("fast", SUPPLY_STALE_NS) == (math.inf, False)
    bench.fresh.mark("fast", bench.now_ns)
    bench.now_ns += 1_000 * MS
    assert bench.fresh.age("fast", SUPPLY_STALE_NS) == pytest.approx((1.0, True))
    assert bench.fresh.age("fast") == pytest.approx((1.0, False))
    bench.now_ns += 1
    assert bench.fresh.age("fast", SUPPLY_STALE_NS) == pytest.approx((1.0, False))


def test_a_kind_is_fresh_up_to_and_with_its_limit(bench: Bench) -> None:
    bench.fresh.mark("fast", bench.now_ns)
    bench.now_ns += 10 * MS
    assert bench.fresh.age("fast") == pytest.approx((0.010, True))
    bench.now_ns += 1
    assert bench.fresh.age("fast") == pytest.approx((0.010, False))


def test_while_other_frames_come_a_kind_may_be_missing_for_five_periods(bench: Bench) -> None:
    assert PATIENCE_PERIODS == 5
    bench.fresh.mark("slow", bench.now_ns)
    bench.now_ns += 100 * MS // 3
    bench.fresh.mark("fast", bench.now_ns)
    assert bench.fresh.age("slow")[1]
    bench.now_ns += 1 * MS
    assert not bench.fresh.age("slow")[1]


def test_that_counts_only_while_the_other_frames_are_no_older_than_the_limit(bench: Bench) -> None:
    bench.fresh.mark("slow", bench.now_ns - 5 * MS)
    bench.fresh.mark("fast", bench.now_ns - 1)
    bench.now_ns += 20 * MS - 1
    assert bench.fresh.age("slow") == pytest.approx((0.025, True))
    bench.now_ns += 1
    assert bench.fresh.age("slow") == pytest.approx((0.025, False))


def test_every_kind_has_its_own_age_and_limit(bench: Bench) -> None:
    bench.fresh.mark("slow", bench.now_ns)
    bench.now_ns += 15 * MS
    assert bench.fresh.age("slow") == pytest.approx((0.015, True))
    assert bench.fresh.age("fast") == (math.inf, False)
    bench.fresh.mark("fast", bench.now_ns)
    assert bench.fresh.age("fast") == (0.0, True)
    assert bench.fresh.age("slow")[0] == pytest.approx(0.015)


def test_a_frame_that_was_stamped_after_the_clock_was_read_is_fresh(bench: Bench) -> None:
    bench.fresh.mark("fast", bench.now_ns + 500)
    assert bench.fresh.age("fast") == pytest.approx((-0.5e-6, True))


@given(st.lists(st.tuples(st.sampled_from(["fast", "slow"]), st.integers(0, 10**18)), min_size=1))
def test_the_newest_of_all_is_the_latest_stamp_in_whatever_order_they_came(marks: list[tuple[str, int]]) -> None:
    fresh = Freshness({"fast": 1, "slow": 1}, lambda: 0)
    for kind, received_ns in marks:
        fresh.mark(kind, received_ns)
    assert fresh.newest_ns == max(received_ns for _, received_ns in marks)


def test_a_gap_is_ridden_through_for_as_long_as_is_set() -> None:
    bench = Bench()
    bench.fresh = Freshness({"fast": 10 * MS, "slow": 20 * MS}, lambda: bench.now_ns, 0.05)
    bench.fresh.mark("fast", bench.now_ns)
    bench.fresh.mark("slow", bench.now_ns)
    bench.now_ns += 60 * MS
    assert bench.fresh.age("fast")[1]
    bench.now_ns += 1
    assert not bench.fresh.age("fast")[1]
    bench.now_ns += 10 * MS - 1
    assert bench.fresh.age("slow")[1]
    bench.now_ns += 1

    assert not bench.fresh.age("slow")[1]


def test_gaps_are_counted_and_the_longest_is_kept(bench: Bench) -> None:
    assert bench.fresh.health == {"gaps": "0", "longest_gap_ms": "0.0"}
    for after_ms in (5, 10, 12, 31, 11, 3):
        bench.now_ns += after_ms * MS
        bench.fresh.mark("slow", bench.now_ns)
        bench.fresh.mark("fast", bench.now_ns - MS)

    assert bench.fresh.health == {"gaps": "3", "longest_gap_ms": "31.0"}
