# SPDX-License-Identifier: MIT
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from segway_ecc.node.cycle.setpoints import CAPACITY, REST, Setpoint, SetpointRefusal, SetpointSchedule

SLOW, FAST = Setpoint(0.5, -0.25), Setpoint(2.0, 1.0)


@pytest.fixture
def schedule() -> SetpointSchedule:
    return SetpointSchedule(timeout_cycles=5, tolerance_cycles=3, horizon_cycles=20)


def test_rest_is_in_force_at_first_and_is_never_silent(schedule: SetpointSchedule) -> None:
    assert schedule.due(0) == REST == (0.0, 0.0)
    assert schedule.is_idle(0)
    assert not schedule.is_silent(10**9)
    assert not schedule.came_into_force(0)


def test_a_set_point_waits_for_its_cycle_and_then_stays(schedule: SetpointSchedule) -> None:
    assert schedule.add(FAST, 7, now=4) is None
    assert [schedule.due(n) for n in (5, 6, 7, 8, 9)] == [REST, REST, FAST, FAST, FAST]
    assert [schedule.came_into_force(n) for n in (6, 7, 8)] == [False, True, False]
    assert schedule.applied == 1


def test_it_is_idle_but_while_one_waits_and_for_a_time_out_after(schedule: SetpointSchedule) -> None:
    schedule.add(FAST, 7, now=4)
    assert not schedule.is_idle(6)
    schedule.due(7)
    assert [schedule.is_idle(n) for n in (7, 12, 13)] == [False, False, True]


def test_a_set_point_applied_on_arrival_does_not_keep_it_from_being_idle(schedule: SetpointSchedule) -> None:
    schedule.add(FAST, 4, now=4)
    schedule.due(4)
    assert schedule.is_idle(4)


def test_set_points_come_into_force_in_the_order_of_their_cycles(schedule: SetpointSchedule) -> None:
    schedule.add(FAST, 9, now=5)
    schedule.add(SLOW, 8, now=5)
    assert [schedule.due(n) for n in (7, 8, 9)] == [REST, SLOW, FAST]


def test_of_two_for_the_same_cycle_the_one_that_came_last_counts(schedule: SetpointSchedule) -> None:
    schedule.add(FAST, 6, now=5)
    schedule.add(SLOW, 6, now=5)
    assert schedule.due(6) == SLOW
    assert schedule.applied == 2


def test_a_late_one_within_the_tolerance_is_applied_on_arrival_and_counted(schedule: SetpointSchedule) -> None:
    schedule.add(SLOW, 10, now=10)
    assert schedule.add(FAST, 7, now=10) is None
    assert schedule.due(10) == FAST
    assert schedule.came_into_force(10)
    assert schedule.late == 1


@pytest.mark.parametrize(
    ("setpoint", "cycle", "refusal"),
    [
        (Setpoint(math.nan, 0.0), 10, SetpointRefusal.NOT_FINITE),
        (Setpoint(0.0, math.inf), 10, SetpointRefusal.NOT_FINITE),
        (Setpoint(-math.inf, 0.0), 0, SetpointRefusal.NOT_FINITE),
        (FAST, 6, SetpointRefusal.STALE),
        (FAST, 7, None),
        (FAST, 30, None),
        (FAST, 31, SetpointRefusal.TOO_FAR_AHEAD),
    ],
)
def test_what_is_taken_and_what_is_refused_in_cycle_10(
    schedule: SetpointSchedule, setpoint: Setpoint, cycle: int, refusal: SetpointRefusal | None
) -> None:
    schedule.add(SLOW, 9, now=9)
    schedule.due(9)
    assert schedule.add(setpoint, cycle, now=10) is refusal
    assert dict(schedule.refused) == ({} if refusal is None else {refusal: 1})
    if refusal is not None:
        assert schedule.due(40) == SLOW  # the last good one
        assert schedule.late == 0


def test_no_more_than_the_capacity_may_wait(schedule: SetpointSchedule) -> None:
    for _ in range(CAPACITY):
        assert schedule.add(SLOW, 5, now=1) is None
    assert schedule.add(FAST, 5, now=1) is SetpointRefusal.QUEUE_FULL
    assert schedule.due(5) == SLOW
    assert schedule.applied == CAPACITY
    assert schedule.add(FAST, 6, now=6) is None


def test_it_is_silent_once_more_than_the_time_out_has_passed_since_the_last_renewal(schedule: SetpointSchedule) -> None:
    schedule.add(FAST, 2, now=2)
    schedule.due(2)
    assert [schedule.is_silent(n) for n in (2, 7, 8)] == [False, False, True]
    schedule.add(FAST, 8, now=8)
    schedule.due(8)
    assert not schedule.is_silent(8)


def test_what_waits_does_not_count_as_a_renewal(schedule: SetpointSchedule) -> None:
    schedule.add(FAST, 0, now=0)
    schedule.add(FAST, 15, now=0)
    schedule.due(6)
    assert schedule.came_into_force(6)
    assert schedule.is_silent(12)


def test_clearing_discards_set_points_and_keeps_the_counts(schedule: SetpointSchedule) -> None:
    schedule.add(FAST, 0, now=0)
    schedule.add(SLOW, 9, now=0)
    schedule.due(0)
    schedule.clear()
    assert schedule.due(9) == REST
    assert not schedule.is_silent(100)
    assert schedule.applied == 1


def test_what_the_caller_refuses_is_counted_too(schedule: SetpointSchedule) -> None:
    schedule.refuse(SetpointRefusal.NOT_ARMED)
    schedule.refuse(SetpointRefusal.NOT_ARMED)
    assert schedule.refused == {SetpointRefusal.NOT_ARMED: 2}


@settings(derandomize=True)
@given(st.lists(st.tuples(st.integers(0, 25), st.integers(0, 30)), max_size=40).map(sorted))
def test_the_one_in_force_is_always_the_newest_of_those_whose_cycle_has_come(arrivals: list[tuple[int, int]]) -> None:
    """Each pair is the cycle of arrival and the cycle it is for."""
    schedule = SetpointSchedule(timeout_cycles=100, tolerance_cycles=3, horizon_cycles=20)
    named = [(now, wanted, Setpoint(float(number), 0.0)) for number, (now, wanted) in enumerate(arrivals, start=1)]
    good = [(now, wanted, s) for now, wanted, s in named if now - 3 <= wanted <= now + 20]
    for cycle in range(60):
        for now, wanted, setpoint in named:
            if now == cycle:
                schedule.add(setpoint, wanted, now)
        # The number in the set-point is its order of arrival.
        come = [(max(now, wanted), s) for now, wanted, s in good if now <= cycle and wanted <= cycle]
        assert schedule.due(cycle) == (max(come)[1] if come else REST)
    assert (schedule.applied, schedule.refused.total()) == (len(good), len(named) - len(good))


LIMITS = Setpoint(1.0, 2.0)


@pytest.mark.parametrize(
    ("asked", "taken", "clamped"),
    [
        (Setpoint(1.0, -2.0), Setpoint(1.0, -2.0), 0),
        (Setpoint(1.5, 0.5), Setpoint(1.0, 0.5), 1),
        (Setpoint(-3.0, 9.0), Setpoint(-1.0, 2.0), 1),
        (Setpoint(0.5, -2.1), Setpoint(0.5, -2.0), 1),
    ],
)
def test_a_set_point_beyond_the_limits_is_clamped_where_that_is_set(
    asked: Setpoint, taken: Setpoint, clamped: int
) -> None:
    schedule = SetpointSchedule(5, 3, 20, LIMITS, clamps=True)
    assert schedule.add(asked, 4, now=4) is None
    assert schedule.due(4) == taken
    assert (schedule.clamped, schedule.refused) == (clamped, {})
    refusing = SetpointSchedule(5, 3, 20, LIMITS)
    assert (refusing.add(asked, 4, now=4) is SetpointRefusal.TOO_LARGE) == (asked != taken)
    assert refusing.clamped == 0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused_and_never_clamped(bad: float) -> None:
    schedule = SetpointSchedule(5, 3, 20, LIMITS, clamps=True)
    assert schedule.add(Setpoint(bad, 0.0), 4, now=4) is SetpointRefusal.NOT_FINITE
    assert schedule.add(Setpoint(5.0, bad), 4, now=4) is SetpointRefusal.NOT_FINITE
    assert (schedule.clamped, schedule.due(4)) == (0, REST)


def test_one_that_is_refused_for_another_cause_is_not_counted_as_clamped() -> None:
    schedule = SetpointSchedule(5, 3, 20, LIMITS, clamps=True)
    assert schedule.add(Setpoint(5.0, 0.0), 0, now=10) is SetpointRefusal.STALE
    assert schedule.clamped == 0
