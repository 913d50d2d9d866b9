# SPDX-License-Identifier: MIT
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.node.cycle.setpoints import REST, Setpoint, SetpointRefusal
from segway_ecc.node.cycle.timing import TimeBase
from segway_ecc.node.cycle.trajectory import (
    MOST_POINTS,
    TimedSetpoint,
    Trajectory,
    TrajectoryFollower,
    TrajectoryState,
    TrajectoryStatus,
)

PERIOD_NS = 10_000_000
ANCHOR_NS = 1_700_000_000_000_000_000
AHEAD = Setpoint(1.0, 0.5)
CURVE = Setpoint(0.5, -0.5)
LARGEST = Setpoint(2.0, 3.0)


@pytest.fixture
def follower() -> TrajectoryFollower:
    time_base = TimeBase(PERIOD_NS)
    time_base.anchor(0, ANCHOR_NS)
    return TrajectoryFollower(time_base, LARGEST, horizon_cycles=100)


def points(*timed: tuple[int, Setpoint]) -> tuple[TimedSetpoint, ...]:
    """Set-points by the cycle after the start."""
    return tuple(TimedSetpoint(cycles * PERIOD_NS, setpoint) for cycles, setpoint in timed)


MANOEUVRE = points((0, AHEAD), (2, CURVE), (4, REST))


def stamp_ns(cycle: int) -> int:
    return ANCHOR_NS + cycle * PERIOD_NS


def refusal(follower: TrajectoryFollower, trajectory: Trajectory, now: int = 10) -> tuple[SetpointRefusal | None, str]:
    cause = follower.take(trajectory, now, is_armed=True)
    return cause, follower.refused[-1].reason if follower.refused else ""


def test_a_trajectory_is_followed_cycle_by_cycle_and_ends_at_rest(follower: TrajectoryFollower) -> None:
    assert follower.take(Trajectory(stamp_ns(12), MANOEUVRE), 10, is_armed=True) is None
    assert [follower.due(cycle) for cycle in range(10, 18)] == [None, None, AHEAD, AHEAD, CURVE, CURVE, REST, None]
    digest = Trajectory(stamp_ns(12), MANOEUVRE).digest
    start_ns, end_ns = stamp_ns(12), stamp_ns(16)
    assert follower.status == TrajectoryStatus(start_ns, TrajectoryState.DONE, "", start_ns, end_ns, 4, digest)


def test_status_goes_from_accepted_to_followed_to_done(follower: TrajectoryFollower) -> None:
    follower.take(Trajectory(stamp_ns(11), MANOEUVRE), 10, is_armed=True)
    states = []
    for cycle in range(10, 16):
        follower.due(cycle)
        states.append(follower.status.state)
    assert states == ["accepted", "followed", "followed", "followed", "followed", "done"]


def test_a_trajectory_without_a_stamp_begins_in_the_cycle_in_which_it_arrives(follower: TrajectoryFollower) -> None:
    follower.take(Trajectory(0, MANOEUVRE), 10, is_armed=True)
    assert follower.due(10) == AHEAD
    assert follower.status.start_ns == stamp_ns(10)


def test_the_robot_rests_before_a_first_point_that_comes_later(follower: TrajectoryFollower) -> None:
    follower.take(Trajectory(0, points((2, AHEAD), (3, REST))), 10, is_armed=True)
    assert [follower.due(cycle) for cycle in range(10, 14)] == [REST, REST, AHEAD, REST]


@pytest.mark.parametrize(("first_ns", "second_ns"), [(0, 1), (0, 4_999_999), (5_000_000, 14_999_999)])
def test_a_trajectory_of_which_two_points_fall_into_one_cycle_is_refused(
    follower: TrajectoryFollower, first_ns: int, second_ns: int
) -> None:
    close = (TimedSetpoint(first_ns, AHEAD), TimedSetpoint(second_ns, CURVE), TimedSetpoint(100_000_000, REST))
    text = "points 0 and 1 fall into one cycle, of 0.01 s: one would not be driven"
    assert refusal(follower, Trajectory(0, close)) == (SetpointRefusal.MALFORMED, text)


def test_every_point_of_one_that_is_accepted_is_driven_also_where_it_falls_between_cycles(
    follower: TrajectoryFollower,
) -> None:
    close = (TimedSetpoint(4_999_999, AHEAD), TimedSetpoint(5_000_000, CURVE), TimedSetpoint(15_000_000, REST))
    assert follower.take(Trajectory(0, close), 10, is_armed=True) is None
    assert [follower.due(10), follower.due(11), follower.due(12)] == [AHEAD, CURVE, REST]


def test_what_its_message_asks_for_beyond_a_trajectory_refuses_it(follower: TrajectoryFollower) -> None:
    asked = Trajectory(0, MANOEUVRE, "it is to fly")
    assert refusal(follower, asked) == (SetpointRefusal.MALFORMED, "it is to fly")


def test_a_new_trajectory_takes_the_place_of_the_one_that_is_followed(follower: TrajectoryFollower) -> None:
    follower.take(Trajectory(0, MANOEUVRE), 10, is_armed=True)
    follower.due(10)
    follower.take(Trajectory(0, points((0, CURVE), (1, REST))), 11, is_armed=True)
    assert [follower.due(11), follower.due(12), follower.due(13)] == [CURVE, REST, None]


def test_an_empty_trajectory_cancels(follower: TrajectoryFollower) -> None:
    follower.take(Trajectory(0, MANOEUVRE), 10, is_armed=True)
    assert follower.take(Trajectory(0, ()), 11, is_armed=True) is None
    assert follower.due(11) is None
    assert (follower.status.state, follower.status.reason) == (TrajectoryState.ABORTED, "the trajectory was cancelled")


def test_an_abort_keeps_its_reason_and_happens_once(follower: TrajectoryFollower) -> None:
    follower.take(Trajectory(0, MANOEUVRE), 10, is_armed=True)
    assert follower.abort("stop was pressed")
    assert not follower.abort("another reason")
    assert follower.status.reason == "stop was pressed"
    assert not follower.is_active


@pytest.mark.parametrize(
    ("trajectory", "cause", "text"),
    [
        (Trajectory(stamp_ns(9), MANOEUVRE), "stale", "it came too late: it was to begin 0.010 s before it arrived"),
        (
            Trajectory(stamp_ns(111), MANOEUVRE),
            "too_far_ahead",
            "it is to begin in 1.010 s; at most 1 s is allowed",
        ),
        (
            Trajectory(0, points((0, AHEAD), (1, Setpoint(math.nan, 0.0)), (2, REST))),
            "not_finite",
            "the velocity of point 1 is missing or not finite",
        ),
        (
            Trajectory(0, points((0, Setpoint(0.0, -3.5)), (1, REST))),
            "too_large",
            "it asks for 3.5 rad/s; at most 3 rad/s is allowed",
        ),
        (Trajectory(0, points((0, Setpoint(1e308, 0.0)), (1, REST))), "too_large", "it asks for 1e+308 m/s"),
        (Trajectory(0, points((0, AHEAD), (0, CURVE), (1, REST))), "malformed", "do not increase"),
        (Trajectory(0, points((-1, AHEAD), (1, REST))), "malformed", "do not increase"),
        (Trajectory(0, points((0, AHEAD), (1, CURVE))), "malformed", "is not at rest"),
        (
            Trajectory(0, points(*((n, REST) for n in range(MOST_POINTS + 1)))),
            "malformed",
            "it is larger than 1000 points may be",
        ),
    ],
)
def test_what_cannot_be_followed_whole_is_refused_whole(
    follower: TrajectoryFollower, trajectory: Trajectory, cause: str, text: str
) -> None:
    found, reason = refusal(follower, trajectory)
    assert found == cause
    assert text in reason
    assert not follower.is_active
    assert follower.status.state is TrajectoryState.NONE


def test_a_robot_that_is_not_armed_refuses(follower: TrajectoryFollower) -> None:
    assert follower.take(Trajectory(0, MANOEUVRE), 10, is_armed=False) is SetpointRefusal.NOT_ARMED
    assert [each.reason for each in follower.refused] == ["the robot is not armed"]


def test_the_same_trajectory_sent_again_changes_nothing(follower: TrajectoryFollower) -> None:
    again = Trajectory(stamp_ns(11), MANOEUVRE)
    follower.take(again, 10, is_armed=True)
    due = [follower.due(11), follower.take(again, 12, is_armed=True), follower.due(12), follower.due(13)]
    assert due == [AHEAD, None, AHEAD, CURVE]
    assert not follower.refused


def test_a_refused_one_leaves_the_one_that_is_followed_alone(follower: TrajectoryFollower) -> None:
    follower.take(Trajectory(0, MANOEUVRE), 10, is_armed=True)
    refusal(follower, Trajectory(stamp_ns(1), MANOEUVRE))
    assert [follower.due(cycle) for cycle in (10, 12, 14)] == [AHEAD, CURVE, REST]


@given(
    st.lists(st.tuples(st.integers(-5, 60) | st.integers(-(2**63), 2**63 - 1), st.floats(), st.floats()), max_size=20),
    st.integers(0, 2**63 - 1),
)
def test_any_trajectory_is_followed_within_limits_or_refused_and_is_over_in_the_end(
    timed: list[tuple[int, float, float]], stamp: int
) -> None:
    time_base = TimeBase(PERIOD_NS)
    time_base.anchor(0, ANCHOR_NS)
    follower = TrajectoryFollower(time_base, LARGEST, horizon_cycles=100)
    given_points = tuple(TimedSetpoint(offset, Setpoint(v, w)) for offset, v, w in timed)
    cause = follower.take(Trajectory(stamp, given_points), 10, is_armed=True)
    if cause is not None or not given_points:
        assert not follower.is_active
        return
    last = 10 + 100 + given_points[-1].offset_ns // PERIOD_NS + 2
    due = [follower.due(cycle) for cycle in (*range(10, min(last, 500)), last)]
    assert all(d is None or (abs(d[0]) <= LARGEST[0] and abs(d[1]) <= LARGEST[1]) for d in due)
    assert not follower.is_active
