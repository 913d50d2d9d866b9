# SPDX-License-Identifier: MIT
"""Between a robot and its station in one process: every change arrives, and of all else the newest."""

import math
from typing import Any
from unittest.mock import MagicMock

import msgspec
import pytest

from segway_ecc.deploy.station.command_handler import CommandHandler
from segway_ecc.deploy.station.fleet import EventLog, Heartbeats
from segway_ecc.deploy.station.robot_messages import Health, ModeReport, Pitch, SetpointReport, Supply
from segway_ecc.hil.demo.local_network import LocalConnection, LocalNetwork, LocalStage
from segway_ecc.node.cycle.interfaces import Heartbeat, Report, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.signals import ODOMETRY_SIGNALS
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.cycle.trajectory import CANCEL, TrajectoryState, TrajectoryStatus
from segway_ecc.node.safety.modes import Action, Answer, Mode
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.sequence.manoeuvre import Odometry

REPORT = Report(
    stamp_ns=7,
    mode=Mode.ARMED,
    values=[1.0, 2.0, 3.0, 4.0, 5.0, 17.5],
    applied=StampedSetpoint(Setpoint(0.5, 0.25), 6),
    topics=[9.0, 0.125],
    reason="asked to arm",
    drives="on",
    is_zero=False,
    heartbeat=Heartbeat("base", 40),
    heartbeat_age_ns=2,
    is_introduced=True,
    posture=Posture.BALANCING,
)


@pytest.fixture
def network() -> LocalNetwork:
    made = LocalNetwork(lambda: 0)
    made.is_alive = True
    return made


@pytest.fixture
def stage(network: LocalNetwork) -> LocalStage:
    robot = MagicMock()
    robot.file.name = "alice"
    robot.wiring.topics = {"energy": "Energy", "pitch": "Pitch"}
    robot.wiring.published = dict.fromkeys((*ODOMETRY_SIGNALS, "supply.voltage"))
    return LocalStage(robot, network)


@pytest.fixture
def heard(network: LocalNetwork) -> list[Any]:
    """What the station's handler is told, once it is polled."""
    found = list[Any]()
    handler = MagicMock(on_message=lambda _name, message, _at_ns: found.append(message))
    handler.is_waiting_for.return_value = False
    with network.connect(handler, None, EventLog(lambda: 0)):
        return found


def test_a_cycle_is_reported_as_over_ros(network: LocalNetwork, stage: LocalStage, heard: list[Any]) -> None:
    stage.publish(REPORT)
    stage.publish_diagnostics(7, [DiagnosticStatus(Level.OK, "alice: timing", "", {"rate_hz": "200"})])
    network.poll(everything=True)
    mode = ModeReport(
        name="alice",
        mode=Mode.ARMED,
        reason="asked to arm",
        drives="on",
        is_zero=False,
        station="base",
        beat_ns=40,
        beat_age_ns=2,
        is_introduced=True,
        posture=Posture.BALANCING,
    )
    assert heard == [
        mode,
        mode,
        REPORT.trajectory,
        Pitch(0.125),
        Supply(17.5),
        Odometry(7, 1.0, 2.0, 3.0, 4.0, 5.0),
        SetpointReport(6, 0.5, 0.25),
        Health({}, {}, {"rate_hz": "200"}),
    ]
    network.poll(everything=True)
    assert len(heard) == 8, "each is told once"


def test_odometry_that_is_not_known_is_not_told(network: LocalNetwork, stage: LocalStage, heard: list[Any]) -> None:
    stage.publish(msgspec.structs.replace(REPORT, values=[1.0, math.nan, 3.0, 4.0, 5.0, 17.5], applied=None))
    network.poll(everything=True)
    assert not any(isinstance(message, Odometry | SetpointReport) for message in heard)


def test_no_change_of_mode_is_missed_and_of_all_else_the_newest_counts(
    network: LocalNetwork, stage: LocalStage, heard: list[Any]
) -> None:
    refused = TrajectoryStatus(1, TrajectoryState.REFUSED, "too late", 0, 0)
    stage.publish(REPORT)
    stage.publish(msgspec.structs.replace(REPORT, mode=Mode.FAULT, refused_trajectory=refused))
    stage.publish(msgspec.structs.replace(REPORT, topics=[0.0, 0.5]))
    stage.publish(msgspec.structs.replace(REPORT, topics=[0.0, 0.75]))
    network.poll(everything=True)
    changes = [message for message in heard if isinstance(message, ModeReport)]
    assert [change.mode for change in changes] == [Mode.ARMED, Mode.FAULT, Mode.ARMED, Mode.ARMED]
    assert refused in heard
    assert [message for message in heard if isinstance(message, Pitch)] == [Pitch(0.75)]


def test_what_the_station_sends_is_in_the_next_inbox(network: LocalNetwork, stage: LocalStage) -> None:
    connection = LocalConnection(network)
    connection.drive(Setpoint(1.0, 2.0))
    connection.follow(CANCEL)
    connection.introduce("base")
    number = connection.call(Action.ARM)
    inbox = stage.take_inbox()
    assert inbox.setpoints == [StampedSetpoint(Setpoint(1.0, 2.0), None)]
    assert (inbox.trajectories, inbox.introductions) == ([CANCEL], ["base"])
    (request,) = inbox.requests
    assert request.action is Action.ARM
    assert list(connection.responses()) == []
    request.answer(Answer(accepted=False, message="no"))
    (response,) = connection.responses()
    assert (response.action, response.number, response.accepted, response.message) == (Action.ARM, number, False, "no")
    assert stage.take_inbox().requests == []


def test_a_robot_takes_no_more_than_some_at_once(network: LocalNetwork, stage: LocalStage) -> None:
    for place in range(40):
        LocalConnection(network).drive(Setpoint(float(place), 0.0))
    assert [len(stage.take_inbox().setpoints) for _ in range(3)] == [32, 8, 0]


def test_a_dead_node_receives_nothing(network: LocalNetwork, stage: LocalStage) -> None:
    network.is_alive = False
    connection = LocalConnection(network)
    assert not connection.is_ready(Action.STOP)
    connection.call(Action.STOP)
    assert stage.take_inbox().requests == []


def test_heartbeats_are_sent_where_one_is_due(network: LocalNetwork, stage: LocalStage) -> None:
    beats, events = Heartbeats("base"), EventLog(lambda: 0)
    with network.connect(CommandHandler(events, beats, Setpoint(1.0, 1.0)), beats, events):
        for now_ns in (1, 2, 100_000_001):
            network.beat(now_ns)
    assert stage.take_inbox().stations == [Heartbeat("base", 1), Heartbeat("base", 100_000_001)]
