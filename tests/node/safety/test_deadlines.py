# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.node.safety.deadlines import LATE_FRACTION, WINDOW_S, DeadlineWatch, RateMeter
from segway_ecc.node.safety.settings import LateCyclesLimit

MS = 1_000_000
PERIOD = 10 * MS


def in_a_row(count: int, limit: int) -> str:
    return f"{count} deadlines in a row were missed, fewer than {limit} are allowed"


SLOW = "a step takes longer than its period, or the machine is too busy"
IN_WINDOW = f"3 of the last 10 deadlines were missed, fewer than 3 are allowed: {SLOW}"


def row(limit: int = 3) -> DeadlineWatch:
    return DeadlineWatch(LateCyclesLimit(in_a_row=limit), PERIOD)


def window(limit: int = 3) -> DeadlineWatch:
    return DeadlineWatch(LateCyclesLimit(in_a_row=1000, in_window=limit, window_s=0.1), PERIOD)


def test_missed_is_what_started_more_than_half_a_period_late() -> None:
    assert LATE_FRACTION == 0.5
    watch = row(1)
    assert watch.look(1, 5 * MS) is None
    assert watch.look(1, 5 * MS + 1) == in_a_row(1, 1)


def test_single_skipped_deadline_counts_as_missed() -> None:
    assert row(1).look(2, 0) == in_a_row(1, 1)


def test_late_cycles_in_a_row_fault_and_one_in_time_ends_the_row() -> None:
    watch = row()
    assert [watch.look(1, late * MS) for late in (6, 6, 0, 6, 6)] == [None] * 5
    assert watch.look(1, 6 * MS) == in_a_row(3, 3)
    assert watch.look(1, 6 * MS) == in_a_row(4, 3)
    assert watch.look(1, 0) is not None, "a row that was too long is told as long as its end"
    assert watch.look(1, 0) is None


def test_skipped_deadlines_count_in_the_row_even_where_the_next_cycle_is_in_time() -> None:
    assert row().look(3, 0) is None
    assert row().look(4, 0) == in_a_row(3, 3)
    assert row().look(3, 9 * MS) == in_a_row(3, 3)
    assert row().look(2, 9 * MS) is None


@pytest.mark.parametrize(("every", "told"), [(3, True), (4, True), (5, False)])
def test_late_cycles_within_the_window_fault(every: int, told: bool) -> None:  # noqa: FBT001 - a column of the table
    watch = window()
    found = [watch.look(1, 9 * MS if n % every == 0 else 0) for n in range(1, 60)]
    assert any(found) == told
    assert not told or IN_WINDOW in found


def test_window_fault_lasts_until_the_window_has_passed() -> None:
    watch = window()
    found = [watch.look(1, 9 * MS if n < 3 else 0) is not None for n in range(20)]
    assert found == [False] * 2 + [True] * 8 + [False] * 10


def test_skipped_deadlines_count_in_the_window_at_their_own_time() -> None:
    watch = window()
    assert watch.look(3, 0) is None, "two were skipped"
    assert watch.look(1, 9 * MS) is not None
    assert [watch.look(1, 0) is not None for _ in range(9)] == [True] * 6 + [False] * 3, "the first was deadline 1"


def test_a_gap_that_is_longer_than_everything_is_counted_as_it_should_be() -> None:
    watch = window()
    assert watch.look(10_000, 0) == in_a_row(9999, 1000)
    watch = DeadlineWatch(LateCyclesLimit(in_a_row=10_000, in_window=3, window_s=0.1), PERIOD)
    assert watch.look(1000, 0) == IN_WINDOW
    assert [watch.look(1, 0) is not None for _ in range(9)] == [True] * 6 + [False] * 3, (
        "the newest three were 997 to 999"
    )


def test_without_a_window_none_is_counted() -> None:
    watch = row(1000)
    assert all(watch.look(1, late * MS) is None for late in [9, 0] * 500)


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
