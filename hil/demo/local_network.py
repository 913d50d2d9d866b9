# SPDX-License-Identifier: MIT
"""One robot in the same process as its station, in place of a network: memory that two threads share."""

import contextlib
import itertools
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final

from segway_ecc.deploy.station.command_handler import CommandHandler
from segway_ecc.deploy.station.fleet import EventLog, Heartbeats
from segway_ecc.deploy.station.requests import ServiceResponse
from segway_ecc.deploy.station.robot_messages import (
    Health,
    ModeReport,
    Pitch,
    RobotMessage,
    SetpointReport,
    Supply,
    decode_health,
)
from segway_ecc.node.cycle.interfaces import (
    Heartbeat,
    Inbox,
    NoStage,
    Report,
    Request,
    StampedSetpoint,
)
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.signals import ODOMETRY_SIGNALS, SUPPLY_SIGNAL
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.cycle.trajectory import Trajectory
from segway_ecc.node.robot import Robot
from segway_ecc.node.safety.modes import Action, Answer
from segway_ecc.node.sequence.manoeuvre import Odometry

NAME: Final = "/"
"""Where the robot is, as over ROS without a namespace."""
_PITCH: Final = "pitch"
_KEPT: Final = 1000
"""Changes, answers and messages that wait for a thread which does not come; of more the oldest is discarded."""
_TAKEN: Final = 32

Put = Callable[[Inbox], None]


class LocalStage(NoStage):
    """The robot's end, which its loop uses: see `Stage`. A node that is started again has one of its own."""

    wants_reports = True

    def __init__(self, robot: Robot, network: "LocalNetwork") -> None:
        """Join `robot`."""
        self.over: str | None = None
        self._network = network
        self._name = robot.file.name
        self._topics = tuple(robot.wiring.topics)
        self._places = {signal: place for place, signal in enumerate(robot.wiring.published)}
        self._before: object = None

    def take_inbox(self) -> Inbox:
        """What the station has sent."""
        inbox = Inbox()
        for put in self._network.take_sent():
            put(inbox)
        return inbox

    def publish(self, report: Report) -> None:
        """Keep the newest of everything, and each mode that differs from the one before."""
        mode = self._mode(report)
        state = mode.mode, mode.posture, mode.reason, mode.drives, mode.is_zero
        if state != self._before:
            self._network.changes.append(mode)
        self._before = state
        newest: list[RobotMessage] = [mode, report.trajectory, *self._measured(report)]
        if report.refused_trajectory is not None:
            self._network.changes.append(report.refused_trajectory)
        if report.applied is not None:
            setpoint = report.applied.setpoint
            newest.append(
                SetpointReport(report.applied.stamp_ns or 0, setpoint.linear_velocity, setpoint.angular_velocity)
            )
        for message in newest:
            self._network.newest[type(message)] = message

    def publish_diagnostics(self, _stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Keep the newest."""
        self._network.newest[Health] = decode_health((status.name, status.values) for status in statuses)

    def _mode(self, report: Report) -> ModeReport:
        beat = report.heartbeat
        return ModeReport(
            name=self._name,
            mode=report.mode,
            reason=report.reason,
            drives=report.drives,
            is_zero=report.is_zero,
            station=beat.station if beat else "",
            beat_ns=beat.stamp_ns if beat else 0,
            beat_age_ns=report.heartbeat_age_ns,
            is_introduced=report.is_introduced,
            posture=report.posture,
        )

    def _measured(self, report: Report) -> Iterator[RobotMessage]:
        """What is published of the cycle, while it is known."""
        places = self._places
        if _PITCH in self._topics:
            yield Pitch(report.topics[self._topics.index(_PITCH)])
        if SUPPLY_SIGNAL in places:
            yield Supply(report.values[places[SUPPLY_SIGNAL]])
        if all(signal in places for signal in ODOMETRY_SIGNALS):
            odometry = [report.values[places[signal]] for signal in ODOMETRY_SIGNALS]
            if all(map(math.isfinite, odometry)):
                yield Odometry(report.stamp_ns, *odometry)


class LocalConnection:
    """The station's end; see `RobotConnection`."""

    def __init__(self, network: "LocalNetwork") -> None:
        """Send over `network`."""
        self._network = network
        self._numbers = itertools.count(1)
        self._answers: deque[ServiceResponse] = deque(maxlen=_KEPT)

    def is_ready(self, _action: Action) -> bool:
        """Whether the robot's node runs."""
        return self._network.is_alive

    def call(self, action: Action) -> int:
        """See `RobotConnection.call`."""
        number = next(self._numbers)

        def answer(given: Answer) -> None:
            self._answers.append(ServiceResponse(action, number, given.accepted, given.message))

        self._network.send(lambda inbox: inbox.requests.append(Request(action, answer)))
        return number

    def responses(self) -> Iterable[ServiceResponse]:
        """See `RobotConnection.responses`."""
        while self._answers:
            yield self._answers.popleft()

    def drive(self, setpoint: Setpoint) -> None:
        """See `RobotConnection.drive`."""
        self._network.send(lambda inbox: inbox.setpoints.append(StampedSetpoint(setpoint, None)))

    def follow(self, trajectory: Trajectory) -> None:
        """See `RobotConnection.follow`."""
        self._network.send(lambda inbox: inbox.trajectories.append(trajectory))

    def introduce(self, station: str) -> None:
        """See `RobotConnection.introduce`."""
        self._network.send(lambda inbox: inbox.introductions.append(station))


class LocalNetwork:
    """Between the station's thread and the robot's; see `deploy.station.network.RobotNetwork`.

    Attributes:
        is_alive: Whether the robot's node runs.
        changes: Modes and refusals that the station has not seen yet.
        newest: Of each kind of message the newest that it has not seen.
    """

    def __init__(self, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        """Begin with no robot; messages arrive at the time of `now_ns`, monotonic."""
        self.is_alive = False
        self.changes: deque[RobotMessage] = deque(maxlen=_KEPT)
        self.newest: dict[type, RobotMessage] = {}
        self._now_ns = now_ns
        self._sent: deque[Put] = deque(maxlen=_KEPT)
        self._handler: CommandHandler | None = None
        self._beats: Heartbeats | None = None

    @contextlib.contextmanager
    def connect(self, handler: CommandHandler, beats: Heartbeats | None, _events: EventLog) -> Iterator["LocalNetwork"]:
        """Connect the station; see `Connect`."""
        self._handler, self._beats = handler, beats
        handler.add(NAME, LocalConnection(self))
        yield self

    def send(self, put: Put) -> None:
        """Let a message be put into the robot's next inbox; a robot whose node does not run receives nothing."""
        if self.is_alive:
            self._sent.append(put)

    def take_sent(self) -> Iterator[Put]:
        """What was sent and not taken yet, some of it."""
        for _ in range(min(len(self._sent), _TAKEN)):
            yield self._sent.popleft()

    @property
    def is_waiting(self) -> bool:
        """See `RobotNetwork.is_waiting`."""
        return self._handler is not None and self._handler.is_waiting_for(NAME)

    def poll(self, *, everything: bool) -> None:
        """See `RobotNetwork.poll`."""
        if self._handler is None or not (everything or self.is_waiting):
            return
        self._handler.receive_responses(NAME)
        now_ns = self._now_ns()
        while self.changes:
            self._handler.on_message(NAME, self.changes.popleft(), now_ns)
        if everything:
            for kind in list(self.newest):
                self._handler.on_message(NAME, self.newest.pop(kind), now_ns)

    def beat(self, now_ns: int) -> None:
        """See `RobotNetwork.beat`."""
        stamp_ns = None if self._beats is None else self._beats.due(now_ns)
        if self._beats is not None and stamp_ns is not None:
            beat = Heartbeat(self._beats.name, stamp_ns)
            self.send(lambda inbox: inbox.stations.append(beat))

    def discover(self, now_ns: int) -> None:
        """There is one robot."""

    def refused(self) -> Mapping[str, int]:
        """Nothing of it can be malformed."""
        return {}

    def flush(self) -> None:
        """Nothing is on its way."""
