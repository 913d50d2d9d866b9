# SPDX-License-Identifier: MIT
"""Sequences in the command handler: what begins them, and what ends them."""

from collections.abc import Callable
from typing import Any

import pytest

from segway_ecc.deploy.station.robot_messages import ModeReport
from segway_ecc.deploy.station.views import Act
from segway_ecc.node.cycle.trajectory import CANCEL
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.sequence.manoeuvre import single_segment

MS = 1_000_000
ARMED = ModeReport("alice", Mode.ARMED, "asked to arm", "on", is_zero=False, posture=Posture.BALANCING)
OFF = ModeReport("alice", Mode.FAULT, "stop was pressed", "off")


def test_a_sequence_is_played(bench: Any, texts: Callable[[], list[str]]) -> None:
    bench.play("ann")
    assert bench.replies == [(True, "one is being played")]
    assert bench.state == ("running", "")
    assert bench.robot.controller == "ann"
    bench.pass_time(8000)
    assert bench.state == ("done", "")
    assert texts().count("sequence one: done") == 1


def _bob_takes_over(bench: Any) -> None:
    bench.ask("bob", Act.TAKE_CONTROL)


def _ann_gives_up_control(bench: Any) -> None:
    bench.ask("ann", Act.RELEASE_CONTROL)


def _ann_leaves(bench: Any) -> None:
    bench.handler.leave("ann", bench.now * MS)


def _ann_drives(bench: Any) -> None:
    bench.drive("ann", 1.0)


def _ann_breaks_it_off(bench: Any) -> None:
    bench.ask("ann", Act.BREAK_OFF)


def _bob_stops(bench: Any) -> None:
    bench.ask("bob", Act.STOP)


def _the_robot_faults(bench: Any) -> None:
    bench.report(OFF)
    bench.handler.step(bench.now * MS)


def _the_robot_is_lost(bench: Any) -> None:
    bench.pass_time(bench.now + 1100, alive=False)


def _the_station_ends(bench: Any) -> None:
    bench.handler.close(bench.now * MS)


@pytest.mark.parametrize(
    ("end", "reason"),
    [
        (_bob_takes_over, "bob took control"),
        (_ann_gives_up_control, "ann gave up control"),
        (_ann_leaves, "ann is gone"),
        (_ann_drives, "ann drives by hand"),
        (_ann_breaks_it_off, "ann broke it off"),
        (_bob_stops, "bob pressed stop"),
        (_the_robot_faults, "the robot went to FAULT: stop was pressed"),
        (_the_robot_is_lost, "the robot is lost"),
        (_the_station_ends, "the station ends"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_ended_sequence_brings_robot_to_rest(
    bench: Any, texts: Callable[[], list[str]], end: Callable[[Any], None], reason: str
) -> None:
    bench.play("ann")
    before = len(bench.connection.followed)
    end(bench)
    assert bench.state == ("broken off", reason)
    assert texts().count(f"sequence one: broken off: {reason}") == 1
    assert bench.connection.followed[before:] == [CANCEL]
    bench.pass_time(bench.now + 500)
    assert bench.connection.followed[before:] == [CANCEL]


def test_a_cancel_that_is_not_confirmed_is_in_the_event_log(
    bench: Any, texts: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.play("ann")
    monkeypatch.setattr(bench.connection, "status", lambda _: None)
    bench.ask("ann", Act.BREAK_OFF)
    bench.pass_time(bench.now + 3000)
    bench.pass_time(bench.now + 5000)
    unconfirmed = "sequence one: broken off: ann broke it off; the robot does not confirm that it stopped"
    assert texts().count(unconfirmed) == 1
    monkeypatch.undo()
    bench.pass_time(bench.now + 100)
    assert texts().count("sequence one: broken off: ann broke it off") == 2


def test_zeros_while_a_sequence_is_played_do_not_end_it(bench: Any) -> None:
    bench.play("ann")
    bench.drive("ann", 0.0)
    assert bench.state[0] == "running"
    assert not bench.connection.driven


def test_a_sequence_needs_an_armed_robot_and_control(bench: Any) -> None:
    bench.report(ARMED._replace(mode=Mode.DISARMED, reason="just started"))
    bench.ask("ann", Act.PLAY, manoeuvre=single_segment(1.0, 0.0, 5.0))
    bench.report()
    bench.drive("bob", 1.0)
    bench.ask("ann", Act.PLAY, manoeuvre=single_segment(1.0, 0.0, 5.0))
    bench.ask("bob", Act.PLAY, manoeuvre="one is not YAML")
    bench.ask("bob", Act.BREAK_OFF)
    assert bench.replies == [
        (False, "the robot is DISARMED (just started): arm it first"),
        (False, "bob has control; take it first"),
        (False, "one is not YAML"),
        (False, "nothing is being played"),
    ]


def test_another_sequence_takes_the_place_of_the_first(bench: Any) -> None:
    bench.play("ann")
    bench.ask("ann", Act.PLAY, manoeuvre=single_segment(0.5, 0.0, 1.0))
    assert bench.state == ("waiting", "")
    bench.pass_time(bench.now + 1000)
    assert bench.state == ("running", "")
