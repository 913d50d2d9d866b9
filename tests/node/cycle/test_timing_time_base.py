# SPDX-License-Identifier: MIT
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from segway_ecc.node.cycle.timing import TimeBase

PERIOD = 10_000_000
EPOCH = 1_700_000_000_000_000_000


@pytest.fixture
def base() -> TimeBase:
    base = TimeBase(PERIOD)
    base.anchor(5, EPOCH)
    return base


def test_the_anchored_cycle_bears_its_stamp_and_its_neighbours_differ_by_one_period(base: TimeBase) -> None:
    assert [base.stamp_ns(k) - EPOCH for k in (4, 5, 6, 105)] == [-PERIOD, 0, PERIOD, 100 * PERIOD]


@pytest.mark.parametrize(
    ("offset", "cycle"),
    [(0, 5), (4_999_999, 5), (-4_999_999, 5), (5_000_001, 6), (-5_000_001, 4), (PERIOD, 6), (-5 * PERIOD, 0)],
)
def test_a_stamp_is_for_the_cycle_whose_own_stamp_is_nearest(base: TimeBase, offset: int, cycle: int) -> None:
    assert base.cycle_of(EPOCH + offset) == cycle


@pytest.mark.parametrize("off", [0, 1, 5_000_000, -5_000_000])
def test_up_to_half_a_period_off_the_line_stays(base: TimeBase, off: int) -> None:
    base.follow(5, EPOCH + off)
    assert (base.stamp_ns(5), base.realigned) == (EPOCH, 0)


@pytest.mark.parametrize("off", [5_000_001, -5_000_001, 3_600 * 10**9, -3_600 * 10**9])
def test_time_base_realigns_to_the_wall_clock_and_counts_it(base: TimeBase, off: int) -> None:
    base.follow(5, EPOCH + off)
    assert base.stamp_ns(5) == EPOCH + off
    assert base.stamp_ns(6) == EPOCH + off + PERIOD
    assert base.realigned == 1


@settings(derandomize=True)
@given(st.integers(1, 10**10), st.integers(0, 2 * 10**18), st.integers(0, 10**7), st.integers(-(10**5), 10**7))
def test_every_stamp_leads_back_to_its_cycle(period: int, stamp: int, anchored: int, cycle: int) -> None:
    base = TimeBase(period)
    base.anchor(anchored, stamp)
    assert base.cycle_of(base.stamp_ns(cycle)) == cycle
