# SPDX-License-Identifier: MIT
"""A stop that cannot be delivered yet is kept by namespace until it is confirmed or taken back."""

from collections.abc import Callable
from typing import Any

import pytest

from segway_ecc.deploy.station.fleet import EventLog
from segway_ecc.deploy.station.robot_messages import ModeReport
from segway_ecc.deploy.station.views import Act
from segway_ecc.node.safety.modes import Action, Mode
from tests.deploy.station.conftest import RecordingConnection

ARMED = ModeReport("bob", Mode.ARMED, "asked to arm", "on", is_zero=False)
OFF = ModeReport("bob", Mode.FAULT, "stop was pressed", "off")
MS = 1_000_000
NOT_FOUND = "no robot is found in this namespace; the stop is sent as soon as one is; retries continue"


def found(bench: Any, mode: ModeReport = ARMED) -> RecordingConnection:
    """The robot `/r1` is found, and reports its mode."""
    connection = RecordingConnection()
    bench.handler.add("/r1", connection)
    bench.handler.on_message("/r1", mode, bench.now * MS)
    return connection


def test_stop_of_robot_that_was_not_found_is_sent_when_it_is_found(bench: Any) -> None:
    bench.ask("ann", Act.STOP, robot="/r1")
    assert bench.handler.pending_stops() == {"/r1": "ann"}
    bench.pass_time(60_000)
    assert bench.replies == [(False, NOT_FOUND)]
    shown = bench.handler.view(bench.now * MS).robots[1]
    assert (shown.robot, shown.is_alive, shown.mode, shown.stop) == ("/r1", False, "", "requested")
    connection = found(bench)
    assert not connection.calls
    bench.pass_time(bench.now + 1000)
    assert connection.calls
    assert set(connection.calls) == {Action.STOP}
    bench.handler.on_message("/r1", OFF, bench.now * MS)
    assert bench.handler.view(bench.now * MS).robots[1].stop == "confirmed"
    assert bench.handler.pending_stops() == {}


def test_stop_outlives_restart_of_the_robot(bench: Any) -> None:
    bench.ask("ann", Act.STOP)
    bench.pass_time(5000, alive=False)
    bench.report(ModeReport("alice", Mode.DISARMED, "just started", "on"))
    calls = len(bench.connection.calls)
    bench.pass_time(bench.now + 2000)
    assert len(bench.connection.calls) > calls
    assert bench.robot.stop == "requested"
    bench.report(OFF)
    assert bench.robot.stop == "confirmed"


@pytest.mark.parametrize("robot", ["/r1", "/a"])
def test_stop_that_is_not_confirmed_can_be_taken_back(bench: Any, events: EventLog, robot: str) -> None:
    bench.ask("ann", Act.STOP, robot=robot)
    bench.pass_time(5000, alive=False)  # /a is lost
    bench.ask("bob", Act.CANCEL_STOP, robot=robot)
    assert bench.replies[1:] == [(True, "the stop is no longer sent; if it has arrived, the robot stays in FAULT")]
    assert bench.handler.pending_stops() == {}
    assert (events.after(0)[-1].who, events.after(0)[-1].robot) == ("bob", robot)
    connection = bench.connection if robot == "/a" else found(bench)
    calls = len(connection.calls)
    bench.pass_time(bench.now + 2000)
    assert len(connection.calls) == calls


def test_taking_a_stop_back_needs_control_and_a_stop(bench: Any) -> None:
    bench.ask("ann", Act.CANCEL_STOP)
    bench.ask("ann", Act.TAKE_CONTROL)
    bench.ask("ann", Act.STOP)
    bench.ask("bob", Act.CANCEL_STOP)
    assert bench.replies == [
        (False, "no stop is pending there; a confirmed one ends when the fault is cleared"),
        (True, "you have control"),
        (False, "ann has control; take it first"),
    ]
    assert bench.robot.stop == "requested"


def test_what_is_no_namespace_cannot_be_stopped(bench: Any, replies: Any) -> None:
    for name in ("r1", "", "/r1/", "/a b", "/1r", "//", "/" + "r" * 256):
        bench.ask("ann", Act.STOP, robot=name)
    assert len(replies) == 7
    assert all(text.startswith("no robot can be known as") for _, text in replies)
    assert len(bench.handler.view(0).robots) == 1


def test_stops_of_robots_that_were_not_found_are_bounded_and_cost_known_robots_nothing(bench: Any) -> None:
    for number in range(101):
        bench.ask("vic", Act.STOP, robot=f"/r{number}")
    assert bench.replies == [(False, "100 robots that were not found are to be stopped already")]
    bench.ask("ann", Act.STOP)
    assert bench.connection.calls == [Action.STOP]


def test_end_of_the_station_answers_stops_of_robots_that_were_not_found(
    bench: Any, texts: Callable[[], list[str]]
) -> None:
    bench.ask("ann", Act.STOP, robot="/r1")
    bench.handler.close(bench.now)
    assert bench.replies == [(False, "the station ends")]
    assert texts()[-1] == "stop: failed: the station ends"


def test_report_of_one_of_several_publishers_confirms_no_stop(bench: Any, texts: Callable[[], list[str]]) -> None:
    bench.pass_time(100)
    bench.ask("ann", Act.STOP)
    for _ in range(50):  # somebody else reports that it has stopped, the robot that it has not
        bench.now += 50
        bench.report(OFF._replace(is_out_of_turn=True))
        bench.report(ARMED)
        bench.handler.step(bench.now * MS)
    assert bench.robot.stop == "requested"
    assert bench.replies[0][1].endswith("drives on, by one of several nodes that publish mode; retries continue")
    assert [text.split(":")[0] for text in texts()].count("more than one node publishes mode here") == 1
    bench.now += 1500
    bench.report(OFF)
    assert bench.robot.stop == "confirmed"


def test_robot_that_is_started_anew_is_disputed_for_a_second_only(bench: Any, texts: Callable[[], list[str]]) -> None:
    bench.pass_time(100)
    bench.ask("ann", Act.STOP)
    bench.now += 50
    bench.report(OFF._replace(is_out_of_turn=True))
    assert bench.robot.stop == "requested"
    bench.now += 1000
    bench.report(OFF)
    assert bench.robot.stop == "confirmed"
    assert not any("more than one node" in text for text in texts())
