# SPDX-License-Identifier: MIT
"""What operators ask for, on robots that only a test speaks for."""

from collections.abc import Callable
from typing import Any

import pytest

from segway_ecc.deploy.station.fleet import EventLog
from segway_ecc.deploy.station.requests import ServiceResponse
from segway_ecc.deploy.station.robot_messages import ModeReport
from segway_ecc.deploy.station.views import Act
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.sequence.manoeuvre import single_segment

MS = 1_000_000
S = 1_000_000_000
ARMED = ModeReport("alice", Mode.ARMED, "asked to arm", "on", is_zero=False, posture=Posture.BALANCING)
OFF = ModeReport("alice", Mode.FAULT, "stop was pressed", "off")


@pytest.mark.parametrize("act", sorted(set(Act) - {Act.STOP}))
def test_command_to_unknown_robot_is_refused(bench: Any, act: Act) -> None:
    bench.ask("ann", act, robot="/nobody")
    assert bench.replies == [(False, "no robot is known as /nobody")]
    assert bench.handler.refused == {"command: unknown robot": 1}


@pytest.mark.parametrize(
    ("act", "action"),
    [(Act.ARM, Action.ARM), (Act.DISARM, Action.DISARM), (Act.CLEAR_FAULT, Action.CLEAR_FAULT)],
)
def test_a_request_is_answered_by_the_robot_and_logged(bench: Any, events: EventLog, act: Act, action: Action) -> None:
    bench.ask("ann", act)
    assert bench.connection.calls == [action]
    bench.connection.pending = [ServiceResponse(action, 1, accepted=False, message="tilt: too much")]
    bench.handler.receive_responses("/a")
    assert bench.replies == [(False, "tilt: too much")]
    last = events.after(0)[-1]
    assert (last.robot, last.who, last.text, last.level) == (
        "/a",
        "ann",
        f"{act}: failed: tilt: too much",
        "warning",
    )


@pytest.mark.parametrize(
    "act",
    sorted(set(Act) - {Act.STOP, Act.CANCEL_STOP, Act.TAKE_CONTROL, Act.RELEASE_CONTROL, Act.BREAK_OFF, Act.DISMISS}),
)
def test_commands_to_a_lost_robot_fail_at_once(bench: Any, act: Act) -> None:
    bench.pass_time(1500, alive=False)
    bench.ask("ann", act, manoeuvre=single_segment(1.0, 0.0, 5.0))
    assert bench.replies == [(False, "the robot is lost: nothing received for 1.5 s")]
    assert not bench.connection.calls
    assert bench.robot.controller == ""


def test_a_stop_is_tried_on_a_lost_robot(bench: Any, events: EventLog) -> None:
    bench.pass_time(1500, alive=False)
    bench.ask("ann", Act.STOP)
    assert bench.connection.calls == [Action.STOP]
    bench.pass_time(3600, alive=False)
    assert bench.replies == [(False, "no answer within 2 s, tried 21 times; retries continue")]
    assert bench.robot.stop == "requested"
    assert (events.after(0)[-1].text, events.after(0)[-1].level, events.after(0)[-1].who) == (
        "stop: failed: no answer within 2 s, tried 21 times; retries continue",
        "error",
        "ann",
    )
    bench.report(OFF)
    assert bench.robot.stop == "confirmed"


def test_a_stop_needs_no_control_and_ends_driving_and_refuses_it(bench: Any) -> None:
    bench.drive("ann", 1.0)
    bench.ask("bob", Act.STOP)
    bench.drive("ann", 1.0)
    bench.pass_time(50)
    assert bench.connection.calls == [Action.STOP]
    assert bench.connection.driven == [(1.0, 0.0), (0.0, 0.0)]
    assert bench.handler.refused == {"drive: stopped": 1}
    bench.ask("ann", Act.ARM)
    assert bench.replies == [(False, "a stop is pending; clear the fault first")]
    bench.report(OFF)
    assert bench.replies[1] == (True, "stopped after 50 ms: drives off; stop was pressed")
    assert bench.robot.stop == "confirmed"
    assert bench.robot.stop_after_s == pytest.approx(0.05)
    assert bench.robot.controller == "ann"
    assert not bench.handler.is_waiting_for("/a")


def test_clearing_the_fault_ends_a_stop_that_was_never_confirmed(bench: Any) -> None:
    bench.ask("ann", Act.STOP)
    assert bench.handler.is_waiting_for("/a")
    bench.ask("ann", Act.CLEAR_FAULT)
    assert bench.replies == [(False, "the fault was cleared before the stop was confirmed")]
    assert bench.connection.calls == [Action.STOP, Action.CLEAR_FAULT]
    assert bench.robot.stop == ""


def test_one_operator_has_control(bench: Any, texts: Callable[[], list[str]]) -> None:
    bench.drive("ann", 1.0)
    bench.drive("bob", 2.0)
    bench.ask("bob", Act.ARM)
    assert bench.connection.driven == [(1.0, 0.0)]
    assert bench.replies == [(False, "ann has control; take it first")]
    assert bench.handler.refused == {"drive: another has control": 1, "command: control": 1}
    bench.ask("bob", Act.TAKE_CONTROL)
    assert bench.robot.controller == "bob"
    assert "bob took control from ann" in texts()
    bench.pass_time(50)
    assert bench.connection.driven == [(1.0, 0.0), (0.0, 0.0)]
    bench.drive("ann", 1.0)
    bench.drive("bob", 2.0)
    assert bench.connection.driven[-1] == (2.0, 0.0)


def test_zeros_of_one_without_control_do_not_stop_who_drives(bench: Any) -> None:
    bench.drive("ann", 1.0)
    bench.drive("bob", 0.0)
    bench.pass_time(200)
    assert bench.connection.driven == [(1.0, 0.0)]


def test_expired_driving_is_zeroed_and_logged(bench: Any, texts: Callable[[], list[str]]) -> None:
    bench.drive("ann", 1.0)
    bench.pass_time(300)
    assert bench.connection.driven == [(1.0, 0.0)]
    bench.pass_time(2000)
    assert bench.connection.driven == [(1.0, 0.0)] + 5 * [(0.0, 0.0)]
    assert texts().count("ann no longer drives: brought to rest") == 1


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_set_points_that_are_none_are_refused_and_counted(bench: Any, bad: float) -> None:
    bench.drive("ann", bad)
    bench.drive("ann", 0.0, bad)
    assert not bench.connection.driven
    assert bench.handler.refused == {"drive: not finite": 2}
    assert bench.robot.controller == ""


def test_set_points_beyond_the_limits_are_cut_and_counted(bench: Any) -> None:
    bench.drive("ann", 9.0, -9.0)
    assert bench.connection.driven == [(3.0, -6.0)]
    assert bench.handler.refused == {"drive: clamped to the limits": 1}


def test_a_robot_that_is_not_armed_is_not_driven(bench: Any) -> None:
    bench.report(ARMED._replace(mode=Mode.DISARMED))
    bench.drive("ann", 1.0)
    assert not bench.connection.driven
    assert bench.handler.refused == {"drive: not armed": 1}
    assert bench.robot.controller == ""


def test_an_operator_who_is_gone_drives_and_controls_nothing(bench: Any) -> None:
    bench.drive("ann", 1.0)
    bench.handler.leave("bob", 0)
    assert bench.robot.controller == "ann"
    bench.handler.leave("ann", 0)
    bench.pass_time(50)
    assert bench.robot.controller == ""
    assert bench.connection.driven == [(1.0, 0.0), (0.0, 0.0)]


def test_giving_up_control(bench: Any) -> None:
    bench.ask("ann", Act.RELEASE_CONTROL)
    bench.drive("ann", 1.0)
    bench.ask("ann", Act.RELEASE_CONTROL)
    bench.pass_time(50)
    assert bench.replies == [(False, "you did not have control"), (True, "nobody has control now")]
    assert bench.connection.driven == [(1.0, 0.0), (0.0, 0.0)]


def test_standing_up_and_sitting_down_are_services_whose_refusal_is_shown(bench: Any) -> None:
    bench.ask("ann", Act.STAND)
    bench.ask("ann", Act.SIT)
    assert bench.connection.calls == [Action.STAND_UP, Action.SIT_DOWN]
    why = "clear the fault first: stop was pressed"
    bench.connection.pending = [ServiceResponse(Action.STAND_UP, 1, accepted=False, message=why)]
    bench.handler.receive_responses("/a")
    assert bench.replies == [(False, why)]


def test_a_robot_without_a_posture_is_not_asked_to_stand(bench: Any) -> None:
    bench.report(ARMED._replace(posture=None))
    bench.ask("ann", Act.STAND)
    assert bench.replies == [(False, "this robot cannot stand up or sit down by command")]
    assert bench.connection.calls == []


def test_the_end_of_the_station_answers_everything(bench: Any) -> None:
    bench.drive("ann", 1.0)
    bench.ask("ann", Act.DISARM)
    bench.ask("ann", Act.STOP)
    bench.handler.close(0)
    assert bench.replies == 2 * [(False, "the station ends")]
    assert bench.connection.driven[-1] == (0.0, 0.0)


def test_robots_are_sorted_and_time_goes_on(bench: Any, connection: Any) -> None:
    for name in ("/z", "/", "/b"):
        bench.handler.add(name, connection)
        bench.handler.on_message(name, ARMED, 0)
    picture = bench.handler.view(1500 * MS)
    assert [robot.robot for robot in picture.robots] == ["/", "/a", "/b", "/z"]
    assert picture.time_s == 1.5
