# SPDX-License-Identifier: MIT
from typing import Any

import pytest

from segway_ecc.deploy.station.sequences import SequencePlayback, read_sequence
from segway_ecc.deploy.station.views import SequenceView
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.trajectory import (
    CANCEL,
    TOO_LATE,
    TimedSetpoint,
    Trajectory,
    TrajectoryState,
    TrajectoryStatus,
)
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.sequence.manoeuvre import Odometry

S = 1_000_000_000
MS = 1_000_000
LIMITS = Setpoint(3.0, 6.0)
START = 1700 * S
ONE = "segments: [{linear: 1.0, duration: 1.0}]"


def at(now_ms: int) -> Odometry:
    """The robot's odometry; its wall clock is 1700 s ahead of our monotonic one."""
    return Odometry(START + now_ms * MS, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(autouse=True)
def _exact_stamps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.urandom", bytes)


@pytest.fixture
def playing(replies: Any) -> SequencePlayback:
    return SequencePlayback(read_sequence(ONE, "one", LIMITS), "one", replies, 0)


def status(connection: Any, state: TrajectoryState, reason: str = "") -> TrajectoryStatus:
    """What the robot reports of what was sent last."""
    trajectory = next(each for each in reversed(connection.followed) if each.points)
    stamp_ns, digest = trajectory.stamp_ns, trajectory.digest
    return TrajectoryStatus(
        stamp_ns, state, reason, stamp_ns, stamp_ns + trajectory.points[-1].offset_ns, digest=digest
    )


def test_it_is_sent_whole_to_begin_half_a_second_ahead_and_again_until_the_robot_answers(
    playing: SequencePlayback, connection: Any
) -> None:
    for now in range(0, 1150, 50):
        playing.step(connection, at(now), now * MS)
    points = (TimedSetpoint(0, Setpoint(1.0, 0.0)), TimedSetpoint(S, Setpoint(0.0, 0.0)))
    assert connection.followed == [Trajectory(START + 500 * MS, points)] * 3
    playing.on_status(status(connection, TrajectoryState.ACCEPTED))
    playing.step(connection, at(1700), 1700 * MS)
    assert len(connection.followed) == 3


def test_it_is_played_to_its_end(playing: SequencePlayback, connection: Any, replies: Any) -> None:
    assert playing.view == SequenceView(name="one", fraction=0.0, state="waiting")
    playing.step(connection, at(0), 0)
    assert not replies
    playing.on_status(status(connection, TrajectoryState.ACCEPTED))
    assert replies == [(True, "one is being played")]
    playing.step(connection, at(1000), S)
    view = playing.view
    assert (view.name, view.fraction, view.state) == ("one", 0.5, "running")
    assert (view.path[0], view.path[-1]) == ((0.0, 0.0), (1.0, 0.0))
    playing.on_status(status(connection, TrajectoryState.DONE))
    assert playing.view.state == "running"
    playing.step(connection, at(1500), 1500 * MS)
    assert playing.view == SequenceView(name="one", fraction=1.0, state="done")
    assert playing.outcome == "sequence one: done"
    assert len(replies) == 1


def test_a_robot_that_does_not_answer_makes_it_fail(playing: SequencePlayback, connection: Any, replies: Any) -> None:
    for now in range(0, 2051, 50):
        playing.step(connection, at(now), now * MS)
    assert replies == [(False, "sequence one: failed: the robot does not answer whether it takes it")]
    assert connection.followed[-1] == CANCEL


def test_a_robot_that_gives_no_odometry_makes_it_fail(playing: SequencePlayback, connection: Any, replies: Any) -> None:
    playing.step(connection, None, 2 * S)
    assert playing.view.state == "waiting"
    playing.step(connection, None, 2 * S + 1)
    assert playing.view.state == "failed"
    assert not connection.followed
    assert replies[0][0] is False


def test_a_refusal_is_shown_with_the_robots_reason(playing: SequencePlayback, connection: Any, replies: Any) -> None:
    playing.step(connection, at(0), 0)
    playing.on_status(status(connection, TrajectoryState.REFUSED, "it asks for 3 m/s; at most 1 m/s is allowed"))
    text = "the robot refused it: it asks for 3 m/s; at most 1 m/s is allowed"
    assert replies == [(False, f"sequence one: failed: {text}")]


def test_one_that_came_too_late_is_sent_again_with_more_time(playing: SequencePlayback, connection: Any) -> None:
    playing.step(connection, at(0), 0)
    playing.on_status(status(connection, TrajectoryState.REFUSED, f"{TOO_LATE}: it was to begin 0.010 s before"))
    playing.step(connection, at(50), 50 * MS)
    assert [sent.stamp_ns for sent in connection.followed] == [START + 500 * MS, START + 1050 * MS]
    assert playing.view.state == "waiting"


def test_one_that_the_robot_breaks_off_has_its_reason(playing: SequencePlayback, connection: Any) -> None:
    playing.step(connection, at(0), 0)
    playing.on_status(status(connection, TrajectoryState.FOLLOWED))
    playing.on_status(status(connection, TrajectoryState.ABORTED, "another trajectory took its place"))
    assert playing.outcome == "sequence one: broken off: another trajectory took its place"


def test_the_answer_to_another_trajectory_is_none_of_ours(
    playing: SequencePlayback, connection: Any, replies: Any
) -> None:
    playing.step(connection, at(0), 0)
    playing.on_status(status(connection, TrajectoryState.FOLLOWED)._replace(stamp_ns=START))
    assert not replies


def test_breaking_off_cancels_once(playing: SequencePlayback, connection: Any, replies: Any) -> None:
    playing.step(connection, at(0), 0)
    playing.on_status(status(connection, TrajectoryState.FOLLOWED))
    playing.break_off(connection, "bob took control", 700 * MS)
    playing.step(connection, at(750), 750 * MS)
    playing.break_off(connection, "again", 750 * MS)
    assert connection.followed[1:] == [CANCEL]
    assert (playing.view.state, playing.view.reason) == ("broken off", "bob took control")
    assert replies == [(True, "one is being played")]


def test_a_cancel_is_sent_again_until_the_robot_reports_the_end(playing: SequencePlayback, connection: Any) -> None:
    playing.step(connection, at(0), 0)
    followed = status(connection, TrajectoryState.FOLLOWED)
    playing.on_status(followed)
    playing.break_off(connection, "bob took control", S)
    for now in range(1000, 2200, 50):
        playing.on_status(followed)
        playing.step(connection, at(now), now * MS)
    assert connection.followed[1:] == [CANCEL] * 3
    playing.on_status(followed._replace(state=TrajectoryState.ABORTED))
    for now in range(2200, 9000, 50):
        playing.step(connection, at(now), now * MS)
    assert connection.followed[1:] == [CANCEL] * 3
    assert playing.outcome == "sequence one: broken off: bob took control"


def test_a_cancel_that_is_not_confirmed_is_reported_and_sent_while_the_robot_goes_on(
    playing: SequencePlayback, connection: Any
) -> None:
    playing.step(connection, at(0), 0)
    followed = status(connection, TrajectoryState.FOLLOWED)
    playing.on_status(followed)
    playing.break_off(connection, "the robot is lost", S)
    for now in range(1000, 4001, 50):
        playing.step(connection, None, now * MS)
    assert connection.followed[1:] == [CANCEL] * 7
    assert playing.view.reason == "the robot is lost; the robot does not confirm that it stopped"
    playing.on_status(followed._replace(state=TrajectoryState.ABORTED))
    playing.step(connection, None, 4050 * MS)
    assert playing.view.reason == "the robot is lost"


def test_what_the_robot_never_answered_is_cancelled_for_two_seconds_and_when_it_answers_late(
    playing: SequencePlayback, connection: Any
) -> None:
    playing.step(connection, at(0), 0)
    playing.break_off(connection, "ann is gone", 0)
    for now in range(0, 9000, 50):
        playing.step(connection, at(now), now * MS)
    assert connection.followed[1:] == [CANCEL] * 5
    assert playing.view.reason == "ann is gone; the robot does not confirm that it stopped"
    playing.on_status(status(connection, TrajectoryState.FOLLOWED))
    playing.step(connection, at(9000), 9 * S)
    assert connection.followed[1:] == [CANCEL] * 6


def test_one_that_is_broken_off_before_it_began_has_failed(
    playing: SequencePlayback, connection: Any, replies: Any
) -> None:
    playing.break_off(connection, "ann pressed stop", 0)
    assert not connection.followed
    assert replies == [(False, "sequence one: broken off: ann pressed stop")]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("segments: []", "length >= 1"),
        ("[", "is not YAML"),
        ("{}", "missing required field"),
        ("segments: [{linear: 3.1, duration: 1}]", "segment 0 asks for 3.1 m/s and 0 rad/s; allowed are 3 m/s"),
        ("segments: [{duration: 1}, {angular: -6.1, duration: 1}]", "segment 1 asks for 0 m/s and -6.1 rad/s"),
        ("segments: [{linear: .nan, duration: 1}]", "segment 0 asks for nan"),
        ("segments: [{linear: .inf, duration: 1}]", "segment 0 asks for inf"),
        ("segments: [{duration: .nan}]", "segment 0 is shorter|duration"),
        ("segments: [{duration: 0.009}]", "segment 0 is shorter than 0.01 s"),
        ("segments: [{duration: 1}]" + 65_536 * " ", "longer than 64 KiB"),
        ("[" * 500, "nested too deeply"),
        ("!!python/object/apply:os.system ['true']", "is not YAML"),
        (f"segments: [{{duration: 0x{'f' * 6000}}}]", "a number has at most 64 characters"),
        ("a: &a [1]\nb: [*a, *a]", "an alias"),
    ],
)
def test_what_is_no_sequence_is_refused_with_why(text: str, why: str) -> None:
    with pytest.raises(ConfigurationError, match=why):
        read_sequence(text, "mine", LIMITS)


def test_the_limits_themselves_are_allowed() -> None:
    assert read_sequence("segments: [{linear: -3, angular: 6, duration: 0.01}]", "x", LIMITS).segments
