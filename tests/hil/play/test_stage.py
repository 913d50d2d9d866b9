# SPDX-License-Identifier: MIT
"""The keyboard as a stage: set-points, requests, who drives, and what is shown."""

import dataclasses
import logging
import math
import os
import socket
from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec
import pytest

from segway_ecc.hil.play.channel import Key, LoopEnd, Snapshot, TerminalEnd, channel
from segway_ecc.hil.play.stage import PlantControls, PlayStage
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import Inbox, NoStage, Report, StampedSetpoint
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.model.model import Variable
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.safety.modes import Action, Answer, Mode, Modes
from segway_ecc.node.safety.posture import Posture
from segway_ecc.testing import ScriptedClock


class Behind(NoStage):
    """A stage behind, such as ROS, that hands on what the test says and remembers what it was told."""

    def __init__(self) -> None:
        self.inbox = Inbox()
        self.told: list[object] = []

    def take_inbox(self) -> Inbox:
        taken, self.inbox = self.inbox, Inbox()
        return taken

    def publish(self, report: Report) -> None:
        self.told.append(report)

    def publish_diagnostics(self, stamp_ns: int, statuses: Any) -> None:
        self.told.append((stamp_ns, tuple(statuses)))

    def do_background_work(self) -> None:
        self.told.append("looked")

    def close(self) -> None:
        self.told.append("closed")


class Game(NamedTuple):
    """Everything around a stage."""

    stage: PlayStage
    behind: Behind
    terminal: TerminalEnd
    robot: Robot
    control: int
    ends: tuple[socket.socket, socket.socket]
    rig: PlantControls

    def press(self, *keys: Key) -> Inbox:
        for key in keys:
            self.terminal.press(key)
        return self.stage.take_inbox()

    def setpoints(self, *keys: Key) -> list[Setpoint]:
        found = self.press(*keys).setpoints
        assert all(stamp_ns is None for _, stamp_ns in found), "a key is for now"
        return [setpoint for setpoint, _ in found]

    def shown(self, report: Report) -> Snapshot:
        for _ in range(5):  # one of five cycles is shown
            self.stage.publish(report)
        snapshot = self.terminal.newest()
        assert snapshot is not None
        return snapshot


def reported(game: Game, mode: Mode = Mode.ARMED, applied: Setpoint | None = None, **values: float) -> Report:
    signals = list(game.robot.wiring.published)
    numbers = [values.get(signal.rpartition(".")[2], 0.0) for signal in signals]
    return Report(7, mode, numbers, None if applied is None else StampedSetpoint(applied, 7))


@pytest.fixture
def game() -> Iterator[Game]:
    robot = build_robot(load_robot("cart"), ScriptedClock())
    reader, writer = os.pipe()
    ours, theirs = channel()
    behind = Behind()
    rig = PlantControls(writer, robot.period_ns, lambda: True, can_be_pushed=True)
    with ours, theirs:
        yield Game(
            PlayStage(behind, LoopEnd(ours), rig, robot),
            behind,
            TerminalEnd(theirs),
            robot,
            reader,
            (ours, theirs),
            rig,
        )
    os.close(reader)
    os.close(writer)


def test_arrows_step_the_set_point(game: Game) -> None:
    assert game.setpoints(Key.UP, Key.UP, Key.LEFT) == [Setpoint(0.1, 0.0), Setpoint(0.2, 0.0), Setpoint(0.2, 0.2)]
    assert game.setpoints(Key.DOWN, Key.RIGHT, Key.RIGHT) == [
        Setpoint(0.1, 0.2),
        Setpoint(0.1, 0.0),
        Setpoint(0.1, -0.2),
    ]


def test_the_set_point_has_limits(game: Game) -> None:
    assert game.setpoints(*[Key.UP] * 14)[-1] == Setpoint(1.0, 0.0)
    assert game.setpoints(*[Key.RIGHT] * 14)[-1] == Setpoint(1.0, -2.0)
    assert game.setpoints(*[Key.DOWN] * 24)[-1] == Setpoint(-1.0, -2.0)


def test_x_is_rest(game: Game) -> None:
    game.setpoints(Key.UP, Key.LEFT)
    assert game.setpoints(Key.REST) == [REST]
    assert game.setpoints(Key.UP) == [Setpoint(0.1, 0.0)]


def test_the_set_point_is_renewed_only_while_the_terminal_is_alive(game: Game) -> None:
    game.setpoints(Key.UP)
    assert game.setpoints() == []
    assert game.setpoints(Key.ALIVE) == [Setpoint(0.1, 0.0)]
    assert game.setpoints(Key.ALIVE) == [Setpoint(0.1, 0.0)]
    game.setpoints(Key.REST)
    assert game.setpoints(Key.ALIVE) == [], "rest needs no renewal, and must not talk over another driver"


def test_whoever_spoke_last_drives(game: Game) -> None:
    game.setpoints(Key.UP, Key.UP)
    theirs = StampedSetpoint(Setpoint(0.7, 0.0), None)
    game.behind.inbox.setpoints.append(theirs)
    assert game.press().setpoints == [theirs]
    assert game.setpoints(Key.ALIVE) == []
    assert game.setpoints(Key.UP) == [Setpoint(0.1, 0.0)], "taken up again from rest"
    assert game.setpoints(Key.ALIVE) == [Setpoint(0.1, 0.0)]


@pytest.mark.parametrize("mode", [Mode.FAULT, Mode.DISARMED])
def test_what_was_wanted_is_forgotten_when_the_motors_go_off(game: Game, mode: Mode) -> None:
    game.setpoints(Key.UP, Key.UP)
    game.stage.publish(reported(game, Mode.HOLD))
    assert game.setpoints(Key.ALIVE) == [Setpoint(0.2, 0.0)]
    game.stage.publish(reported(game, mode))
    assert game.setpoints(Key.ALIVE) == []
    assert game.setpoints(Key.UP) == [Setpoint(0.1, 0.0)]


@pytest.mark.parametrize(
    ("key", "action"),
    [
        (Key.ARM, Action.ARM),
        (Key.DISARM, Action.DISARM),
        (Key.STOP, Action.STOP),
        (Key.CLEAR_FAULT, Action.CLEAR_FAULT),
    ],
)
def test_requests_are_made_and_their_answers_reported(
    game: Game, caplog: pytest.LogCaptureFixture, key: Key, action: Action
) -> None:
    caplog.set_level(logging.INFO)
    (request,) = game.press(key).requests
    assert request.action is action
    request.answer(Answer(accepted=True, message="done"))
    request.answer(Answer(accepted=False, message="not now"))
    assert caplog.messages == ["done", "refused: not now"]


def test_a_change_of_mode_is_reported_by_the_loop_alone(game: Game, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    modes = Modes()
    game.stage.modes = modes
    (request,) = game.press(Key.ARM).requests
    request.answer(modes.ask(Action.ARM))
    assert modes.mode is Mode.ARMED
    assert caplog.messages == []
    request.answer(modes.ask(Action.ARM))
    assert caplog.messages == ["armed already"]


def test_push_and_break_go_to_the_plant(game: Game) -> None:
    game.press(Key.PUSH, Key.CUT)
    assert os.read(game.control, 4096) == b"write PushForce 50.0\ncut\n"
    for _ in range(10):
        game.press()
    assert os.read(game.control, 4096) == b"write PushForce 0\n"
    assert game.shown(reported(game)).is_bus_broken


def test_q_ends_and_so_does_a_terminal_that_is_gone(game: Game) -> None:
    game.press(Key.QUIT)
    assert game.stage.over == "q was pressed"
    game.ends[1].close()
    game.stage.take_inbox()
    assert game.stage.over == "q was pressed"


def test_a_terminal_that_is_gone_ends_the_robot(game: Game) -> None:
    game.press(Key.ALIVE)
    goes_on = game.stage.over is None
    game.ends[1].close()
    game.stage.take_inbox()
    assert (goes_on, game.stage.over) == (True, "the terminal is gone")


def test_what_ends_the_stage_behind_ends_this_one(game: Game) -> None:
    game.behind.over = "ROS has shut down"
    assert game.stage.over == "ROS has shut down"


def test_everything_is_handed_on(game: Game) -> None:
    report, status = reported(game), DiagnosticStatus(Level.OK, "cart: other", "", {})
    game.stage.publish(report)
    game.stage.publish_diagnostics(3, [status])
    game.stage.do_background_work()
    game.stage.close()
    assert game.behind.told == [report, (3, (status,)), "looked", "closed"]


def test_what_is_shown(game: Game) -> None:
    modes = Modes()
    game.stage.modes = modes
    health = {
        "link": "x",
        "link.owner": "serial",
        "link.can.state": "passive",
        "link.serial.state": "active",
        "link.can.sent": "3",
        "board.bus_voltage_v": "36.0",
        "lost": "0",
    }
    timing = {"rate_hz": "100", "late": "1", "skipped": "2", "lateness": "p50", "cycle": "x"}
    game.stage.publish_diagnostics(
        3,
        [
            DiagnosticStatus(Level.OK, "cart: hardware", "", health),
            DiagnosticStatus(Level.OK, "cart: timing", "", timing),
        ],
    )
    game.stage.messages.append("hello")
    report = reported(game, applied=Setpoint(0.3, -0.4), linear_velocity=0.25, angular_velocity=-0.5)
    shown = game.shown(report)

    assert (shown.robot, shown.mode, shown.reason) == ("cart", "ARMED", "just started")
    assert (shown.linear, shown.angular, shown.pitch) == (0.25, -0.5, None)
    assert (shown.wanted_linear, shown.wanted_angular) == (0.3, -0.4)
    assert shown.battery == {"board.bus_voltage_v": "36.0"}
    assert shown.links == {"can": "passive", "serial": "active"}
    assert shown.line == "serial"
    assert shown.posture is None
    assert shown.timing == {"rate_hz": "100", "late": "1", "skipped": "2"}
    assert shown.messages == ["hello"]
    assert (shown.has_ros, shown.guard_runs, shown.can_be_pushed, shown.is_bus_broken) == (False, True, True, False)


def test_in_hold_the_set_point_in_force_is_rest(game: Game) -> None:
    game.shown(reported(game, applied=Setpoint(0.3, 0.0)))
    assert game.shown(reported(game, Mode.HOLD)).wanted_linear == 0.0
    assert game.shown(reported(game)).wanted_linear == 0.3
    game.shown(reported(game, Mode.FAULT))
    assert game.shown(reported(game)).wanted_linear == 0.0


def test_what_is_not_measured_is_not_shown(game: Game) -> None:
    assert game.shown(reported(game, linear_velocity=math.nan)).linear is None


def test_the_tilt_is_shown_where_the_model_shows_it(game: Game) -> None:
    class Leaning:
        step_size = 0.01
        outputs = (Variable("Pitch", "rad"),)

        @staticmethod
        def read(name: str) -> float:
            return {"Pitch": 0.125}[name]

    robot = dataclasses.replace(game.robot, model=Leaning())  # type: ignore[arg-type]  # what is read of a model
    stage = PlayStage(
        NoStage(), LoopEnd(game.ends[0]), PlantControls(game.control, 10, lambda: False, can_be_pushed=False), robot
    )
    assert game._replace(stage=stage, robot=robot).shown(reported(game)).pitch == 0.125


def test_a_robot_with_one_line_shows_its_state_as_that_of_the_bus(game: Game) -> None:
    game.stage.publish_diagnostics(3, [DiagnosticStatus(Level.OK, "cart: hardware", "", {"link.state": "active"})])
    shown = game.shown(reported(game))
    assert (shown.links, shown.line) == ({"can": "active"}, None)


def test_a_robot_that_cannot_stand_up_gets_no_request_to(game: Game) -> None:
    assert game.press(Key.STAND, Key.SIT) == Inbox()
    assert game.shown(reported(game)).posture is None


@pytest.mark.parametrize(("key", "action"), [(Key.STAND, Action.STAND_UP), (Key.SIT, Action.SIT_DOWN)])
@pytest.mark.parametrize("posture", [Posture.RESTING, Posture.STANDING_UP, Posture.BALANCING, Posture.FALLEN])
def test_each_key_asks_for_one_thing_whatever_the_robot_is_doing(
    game: Game, posture: Posture, key: Key, action: Action
) -> None:
    segway = build_robot(load_robot("segway"), ScriptedClock())
    game = game._replace(stage=PlayStage(NoStage(), LoopEnd(game.ends[0]), game.rig, segway), robot=segway)
    report = msgspec.structs.replace(reported(game), posture=posture)
    assert game.shown(report).posture == posture.lower()
    (request,) = game.press(key).requests
    assert request.action is action


def test_q_once_more_ends_a_robot_that_is_on_its_way_down(game: Game) -> None:
    assert game.press(Key.QUIT).requests == []
    assert [request.action for request in game.press(Key.QUIT).requests] == [Action.DISARM]
    assert game.stage.over == "q was pressed"
