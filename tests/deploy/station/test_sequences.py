# SPDX-License-Identifier: MIT
from typing import Any

import pytest

from segway_ecc.deploy.station.robot_messages import SetpointReport
from segway_ecc.deploy.station.sequences import SequencePlayback, read_sequence
from segway_ecc.deploy.station.views import SequenceView
from segway_ecc.node.cycle.setpoints import Setpoint
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


@pytest.fixture
def playing(replies: Any) -> SequencePlayback:
    return SequencePlayback(read_sequence(ONE, "one", LIMITS), "one", replies, 0)


def play(
    playing: SequencePlayback, connection: Any, until_ms: int, *, follows_until_ms: int = 99_999, start_ms: int = 0
) -> None:
    """Let time pass, the robot bringing each set-point into force at its time."""
    for now in range(start_ms, until_ms, 50):
        for stamp, setpoint in list(connection.stamped):
            if stamp == START + now * MS and now < follows_until_ms:
                playing.on_setpoint(SetpointReport(stamp, *setpoint), now * MS)
        playing.step(connection, at(now), now * MS)


def test_set_points_are_stamped_half_a_second_ahead_in_the_robots_time(
    playing: SequencePlayback, connection: Any
) -> None:
    playing.step(connection, at(0), 0)
    assert connection.stamped == [(START + 500 * MS, (1.0, 0.0))]
    playing.step(connection, at(100), 100 * MS)
    assert connection.stamped[1:] == [(START + 600 * MS, (1.0, 0.0))]


def test_it_is_played_to_its_end(playing: SequencePlayback, connection: Any, replies: Any) -> None:
    assert playing.view == SequenceView(name="one", fraction=0.0, state="waiting")
    play(playing, connection, 500)
    assert not replies
    play(playing, connection, 1001, start_ms=500)
    assert replies == [(True, "one is being played")]
    assert playing.view == SequenceView(name="one", fraction=0.5, state="running")
    play(playing, connection, 2000, start_ms=1050)
    assert playing.view == SequenceView(name="one", fraction=1.0, state="done")
    assert playing.outcome == "sequence one: done"
    assert [setpoint for _, setpoint in connection.stamped] == 10 * [(1.0, 0.0)] + [(0.0, 0.0)]
    assert len(replies) == 1


def test_a_robot_that_does_not_take_it_up_makes_it_fail(
    playing: SequencePlayback, connection: Any, replies: Any
) -> None:
    play(playing, connection, 2051, follows_until_ms=0)
    text = "the robot does not follow: none of the set-points came into force"
    assert replies == [(False, f"sequence one: failed: {text}")]
    assert playing.view.state == "failed"


def test_a_robot_that_follows_no_more_makes_it_fail(replies: Any, connection: Any) -> None:
    playing = SequencePlayback(
        read_sequence(ONE.replace("duration: 1.0", "duration: 60"), "long", LIMITS), "", replies, 0
    )
    play(playing, connection, 2501, follows_until_ms=1001)
    assert playing.view.state == "running"
    play(playing, connection, 2601, follows_until_ms=1001, start_ms=2550)
    assert playing.view.state == "failed"
    assert connection.stamped[-1][1] == (0.0, 0.0)


def test_a_robot_that_gives_no_odometry_makes_it_fail(playing: SequencePlayback, connection: Any, replies: Any) -> None:
    playing.step(connection, None, 2 * S)
    assert playing.view.state == "waiting"
    playing.step(connection, None, 2 * S + 1)
    assert playing.view.state == "failed"
    assert not connection.stamped
    assert replies[0][0] is False


def test_an_earlier_set_point_is_none_of_ours(playing: SequencePlayback, connection: Any, replies: Any) -> None:
    playing.on_setpoint(SetpointReport(START, 1.0, 0.0), 0)
    playing.step(connection, at(0), 0)
    playing.on_setpoint(SetpointReport(START + 499 * MS, 1.0, 0.0), 0)
    assert not replies


def test_breaking_off_replaces_what_was_sent_ahead(playing: SequencePlayback, connection: Any, replies: Any) -> None:
    play(playing, connection, 701)
    ahead = {stamp for stamp, _ in connection.stamped if stamp >= START + 700 * MS}
    connection.stamped.clear()
    playing.break_off(connection, "bob took control")
    assert {stamp for stamp, _ in connection.stamped} == ahead | {START + 700 * MS}
    assert all(setpoint == (0.0, 0.0) for _, setpoint in connection.stamped)
    assert playing.view.state == "broken off"
    assert playing.view.reason == "bob took control"
    connection.stamped.clear()
    playing.step(connection, at(750), 750 * MS)
    playing.break_off(connection, "again")
    assert not connection.stamped
    assert replies == [(True, "one is being played")]


def test_one_that_is_broken_off_before_it_began_has_failed(
    playing: SequencePlayback, connection: Any, replies: Any
) -> None:
    playing.break_off(connection, "ann pressed stop")
    assert not connection.stamped
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
    ],
)
def test_what_is_no_sequence_is_refused_with_why(text: str, why: str) -> None:
    with pytest.raises(ConfigurationError, match=why):
        read_sequence(text, "mine", LIMITS)


def test_the_limits_themselves_are_allowed() -> None:
    assert read_sequence("segments: [{linear: -3, angular: 6, duration: 0.01}]", "x", LIMITS).segments
