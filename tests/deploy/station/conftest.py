# SPDX-License-Identifier: MIT
"""A connection that records what is sent, replies that record outcomes, and robots in a process."""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.deploy.station.command_handler import CommandHandler, SubmittedCommand
from segway_ecc.deploy.station.fleet import EventLog, Heartbeats
from segway_ecc.deploy.station.requests import ServiceResponse
from segway_ecc.deploy.station.robot_messages import ModeReport
from segway_ecc.deploy.station.views import Act, Command, Drive, RobotView
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.trajectory import Trajectory, TrajectoryState, TrajectoryStatus
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.sequence.manoeuvre import Odometry, single_segment
from tests.ros_domains import next_domain

NS_PER_MS = 1_000_000
ARMED = ModeReport("alice", Mode.ARMED, "asked to arm", "on", is_zero=False, posture=Posture.BALANCING)
_FAKE = Path(__file__).with_name("fake_robot.py")


class RecordingConnection:
    def __init__(self) -> None:
        self.ready = True
        self.calls: list[Action] = []
        self.driven: list[tuple[float, float]] = []
        self.followed: list[Trajectory] = []
        self.introduced: list[str] = []
        self.pending: list[ServiceResponse] = []

    def is_ready(self, _action: Action) -> bool:
        return self.ready

    def call(self, action: Action) -> int:
        self.calls.append(action)
        return len(self.calls)

    def responses(self) -> list[ServiceResponse]:
        responses, self.pending = self.pending, []
        return responses

    def drive(self, setpoint: Setpoint) -> None:
        self.driven.append((setpoint[0], setpoint[1]))

    def follow(self, trajectory: Trajectory) -> None:
        self.followed.append(trajectory)

    def status(self, now_ns: int) -> TrajectoryStatus | None:
        """What a robot would report of what was sent last."""
        whole = [each for each in self.followed if each.points]
        if not whole:
            return None
        stamp_ns, points = whole[-1].stamp_ns, whole[-1].points
        end_ns = stamp_ns + points[-1].offset_ns
        state = TrajectoryState.DONE if now_ns >= end_ns else TrajectoryState.FOLLOWED
        if not self.followed[-1].points:
            state = TrajectoryState.ABORTED
        return TrajectoryStatus(stamp_ns, state, "", stamp_ns, end_ns, digest=whole[-1].digest)

    def introduce(self, station: str) -> None:
        self.introduced.append(station)


class Replies(list[tuple[bool, str]]):
    def __call__(self, *outcome: Any) -> None:
        self.append(outcome)


class FakeRobots:
    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self.process = process

    def ask(self, robot: str, **question: Any) -> Any:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps({"robot": robot, **question}) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())


class Bench:
    """A command handler with one robot `/a` and a clock that only the test moves."""

    def __init__(self, events: EventLog, connection: Any, replies: Any) -> None:
        self.handler = CommandHandler(events, Heartbeats("base"), Setpoint(3.0, 6.0))
        self.connection, self.replies = connection, replies
        self.now = 0
        self.handler.add("/a", connection)

    def report(self, mode: ModeReport = ARMED) -> None:
        self.handler.on_message("/a", mode, self.now * NS_PER_MS)

    def ask(self, who: str, act: Act, robot: str = "/a", manoeuvre: Any = "") -> None:
        command = Command(id=1, robot=robot, act=act, name="one")
        asked = SubmittedCommand(who, command, self.replies, self.now * NS_PER_MS, manoeuvre)
        (self.handler.stop if act is Act.STOP else self.handler.command)(asked, self.now * NS_PER_MS)

    def drive(self, who: str, linear: float, angular: float = 0.0) -> None:
        self.handler.drive(
            who, Drive(id=1, robot="/a", linear=linear, angular=angular), self.now * NS_PER_MS, self.now * NS_PER_MS
        )

    def pass_time(self, until_ms: int, *, alive: bool = True) -> None:
        while self.now < until_ms:
            self.now += 50
            if alive:
                self.handler.on_message("/a", self.handler.fleet.robots["/a"].mode, self.now * NS_PER_MS)
                self.handler.on_message("/a", Odometry(self.now * NS_PER_MS, 0, 0, 0, 0, 0), self.now * NS_PER_MS)
                status = self.connection.status(self.now * NS_PER_MS)
                if status is not None:
                    self.handler.on_message("/a", status, self.now * NS_PER_MS)
            self.handler.step(self.now * NS_PER_MS)

    def play(self, who: str) -> None:
        self.ask(who, Act.PLAY, manoeuvre=single_segment(1.0, 0.0, 5.0))
        self.pass_time(self.now + 1000)

    @property
    def robot(self) -> RobotView:
        return self.handler.view(self.now * NS_PER_MS).robots[0]

    @property
    def state(self) -> tuple[str, str]:
        assert self.robot.sequence is not None
        return self.robot.sequence.state, self.robot.sequence.reason


@pytest.fixture
def connection() -> RecordingConnection:
    return RecordingConnection()


@pytest.fixture
def replies() -> Replies:
    return Replies()


@pytest.fixture
def events() -> EventLog:
    return EventLog(lambda: 1_700_000_000_000_000_000)


@pytest.fixture
def texts(events: EventLog) -> Callable[[], list[str]]:
    """What the event log holds."""
    return lambda: [event.text for event in events.after(0)]


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A ROS domain of the test's own that never leaves this machine."""
    monkeypatch.setenv("ROS_DOMAIN_ID", next_domain())
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))


@pytest.fixture
def fake_robots(ros_domain: None) -> Iterator[Callable[..., FakeRobots]]:  # noqa: ARG001 - the domain is set first
    """Starts robots in a process of their own."""
    with contextlib.ExitStack() as stack:

        def start(*namespaces: str) -> FakeRobots:
            process = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, str(_FAKE), *namespaces],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    text=True,
                    env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
                )
            )
            stack.callback(process.kill)
            return FakeRobots(process)

        yield start


@pytest.fixture
def bench(events: EventLog, connection: RecordingConnection, replies: Replies) -> Bench:
    bench = Bench(events, connection, replies)
    bench.report()
    return bench
