# SPDX-License-Identifier: MIT
"""A robot that is lost can be dismissed from the picture, and is found again as soon as it is heard."""

from collections.abc import Callable
from typing import Any

import pytest

from segway_ecc.deploy.station.fleet import EventLog
from segway_ecc.deploy.station.robot_messages import ModeReport
from segway_ecc.deploy.station.views import Act
from segway_ecc.node.safety.modes import Action, Mode

OFF = ModeReport("alice", Mode.FAULT, "stop was pressed", "off")
MS = 1_000_000
DISMISSED = (True, "dismissed; it is shown again as soon as it is heard")


def shown(bench: Any) -> list[str]:
    return [robot.robot for robot in bench.handler.view(bench.now * MS).robots]


@pytest.fixture
def lost(bench: Any) -> Any:
    bench.pass_time(1500, alive=False)
    assert not bench.robot.is_alive
    return bench


def test_a_lost_robot_is_dismissed(lost: Any, events: EventLog) -> None:
    lost.ask("ann", Act.DISMISS)
    assert lost.replies == [DISMISSED]
    assert shown(lost) == []
    last = events.after(0)[-1]
    assert (last.robot, last.text, last.who) == ("/a", f"dismiss: {DISMISSED[1]}", "ann")
    lost.pass_time(5000, alive=False)
    assert shown(lost) == []
    lost.ask("ann", Act.ARM)
    assert lost.replies[-1] == (False, "no robot is known as /a")


def test_one_that_is_heard_again_is_found_anew(lost: Any, texts: Callable[[], list[str]]) -> None:
    lost.ask("ann", Act.DISMISS)
    lost.report()
    assert lost.robot.is_alive
    assert texts()[-1] == "found alice: ARMED, BALANCING: asked to arm"
    lost.ask("ann", Act.DISARM)
    assert lost.connection.calls == [Action.DISARM]


def test_one_that_is_heard_is_not_dismissed(bench: Any) -> None:
    bench.ask("ann", Act.DISMISS)
    assert bench.replies == [(False, "the robot is not lost: only one that is can be dismissed")]
    assert shown(bench) == ["/a"]


def test_a_stop_that_is_not_confirmed_keeps_it_in_sight(lost: Any) -> None:
    lost.ask("ann", Act.STOP)
    lost.ask("ann", Act.DISMISS)
    assert lost.replies == [(False, "its stop is not confirmed: it is sent until it is, or until you clear it")]
    assert shown(lost) == ["/a"]
    lost.ask("ann", Act.CANCEL_STOP)
    lost.ask("ann", Act.DISMISS)
    assert lost.replies[-1] == DISMISSED


def test_a_stop_that_is_pressed_afterwards_is_delivered(lost: Any) -> None:
    lost.ask("ann", Act.DISMISS)
    lost.ask("ann", Act.STOP)
    assert shown(lost) == ["/a"], "it is in sight as one that is to be stopped"
    lost.pass_time(lost.now + 1000, alive=False)
    lost.report(OFF)
    assert lost.robot.stop == "confirmed"
    assert Action.STOP in lost.connection.calls


def test_who_has_control_dismisses_it_and_has_it_no_more(bench: Any) -> None:
    bench.ask("ann", Act.TAKE_CONTROL)
    bench.pass_time(1500, alive=False)
    bench.ask("bob", Act.DISMISS)
    assert bench.replies[-1] == (False, "ann has control; take it first")
    bench.ask("ann", Act.DISMISS)
    assert bench.replies[-1] == DISMISSED
    bench.report()
    assert bench.robot.controller == ""


def test_a_sequence_that_was_played_does_not_hold_up_the_station(bench: Any) -> None:
    bench.play("ann")
    bench.pass_time(bench.now + 1500, alive=False)
    bench.ask("ann", Act.DISMISS)
    assert bench.replies[-1] == DISMISSED
    bench.pass_time(bench.now + 1000, alive=False)
    assert shown(bench) == []
    bench.report()
    bench.pass_time(bench.now + 1000)
    assert bench.state == ("broken off", "the robot is lost")
