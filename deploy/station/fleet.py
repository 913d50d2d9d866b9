# SPDX-License-Identifier: MIT
"""What was received of each robot and the picture that it makes, the heartbeats sent to all, and the event log.

Pure but for the event log, which any thread may read: time is given.
"""

import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, TypeVar

from segway_ecc.deploy.station.robot_messages import (
    Health,
    ModeReport,
    Pitch,
    RobotMessage,
    SetpointReport,
    Supply,
    finite,
)
from segway_ecc.deploy.station.views import EventView, RobotView
from segway_ecc.node.cycle.report import state_text
from segway_ecc.node.errors import shortened
from segway_ecc.node.safety.modes import ACTIVE, Mode
from segway_ecc.node.sequence.manoeuvre import Odometry

MOST_ROBOTS: Final = 100
"""More than these are not followed: the graph belongs to whoever is on the network."""
_LOST_AFTER_NS: Final = 1_000_000_000
_FRESH_NS: Final[dict[type, int]] = {
    Odometry: 1_000_000_000,
    SetpointReport: 1_000_000_000,
    Pitch: 1_000_000_000,
    Supply: 10_000_000_000,
    Health: 5_000_000_000,
}
"""How long a received value is shown; an older one counts as unknown."""
_NOT_DRIVEN: Final = SetpointReport(0, 0.0, 0.0)
_LEVELS: Final = {Mode.FAULT: "error", Mode.HOLD: "warning"}
H = TypeVar("H")
_PERIOD_NS: Final = 100_000_000
_AGAIN_NS: Final = 500_000_000
"""Between two introductions to a robot that does not report the first."""
_KEPT_STAMPS: Final = 50
"""Stamps that an echo may carry: those of five seconds."""
_TURNS: Final = 3
_DISPUTED_NS: Final = 1_000_000_000
_DISPUTE_AGAIN_NS: Final = 60_000_000_000
_ECHO_WITHIN_NS: Final = 1_000_000_000
"""Without an echo for longer the robot does not receive our heartbeats."""


class EventLog:
    """Keeps the newest events; discarding the oldest leaves the numbers of the others as they are."""

    def __init__(self, wall_ns: Callable[[], int], capacity: int = 1000) -> None:
        """Keep `capacity` events, stamped by `wall_ns` (ns since the Unix epoch)."""
        self._wall_ns = wall_ns
        self._events: deque[EventView] = deque(maxlen=capacity)
        self._count = 0
        self._lock = threading.Lock()

    def add(self, robot: str, text: str, *, level: str = "info", who: str = "") -> None:
        """Keep an event; a text that is too long is shortened, as some of it comes from the network."""
        with self._lock:
            self._count += 1
            event = EventView(
                number=self._count, wall_ns=self._wall_ns(), robot=robot, text=shortened(text), level=level, who=who
            )
            self._events.append(event)

    def after(self, number: int) -> Sequence[EventView]:
        """The events that are kept and whose number is greater, oldest first."""
        with self._lock:
            new = min(self._count - number, len(self._events))
            return [self._events[index] for index in range(len(self._events) - new, len(self._events))]


class Heartbeats:
    """One clock of heartbeats for all robots; only stamps that we sent count as echoes of ours."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._sent: deque[int] = deque(maxlen=_KEPT_STAMPS)
        self._round_trips: dict[str, tuple[float, int]] = {}
        self._introduced: set[str] = set()
        self._introductions: dict[str, int] = {}

    def due(self, now_ns: int) -> int | None:
        """The stamp of a heartbeat to send now, or None."""
        if self._sent and now_ns - self._sent[-1] < _PERIOD_NS:
            return None
        self._sent.append(now_ns)
        return now_ns

    def on_mode(self, robot: str, mode: ModeReport, at_ns: int) -> None:
        """Measure the round trip from a mode report received at `at_ns`, monotonic, where it echoes us."""
        if mode.station == self.name and mode.beat_ns in self._sent and mode.beat_age_ns <= _ECHO_WITHIN_NS:
            self._round_trips[robot] = (max(at_ns - mode.beat_ns - mode.beat_age_ns, 0) * 1e-9, at_ns)
            (self._introduced.add if mode.is_introduced else self._introduced.discard)(robot)

    def is_introduction_due(self, robot: str, now_ns: int) -> bool:
        """Whether to introduce us to a robot that an operator of ours controls: it does not report that we are.

        Never where no heartbeats are sent, as by a station that only watches.
        """
        is_early = now_ns - self._introductions.get(robot, -_AGAIN_NS) < _AGAIN_NS
        if is_early or not self._sent or robot in self._introduced:
            return False
        self._introductions[robot] = now_ns
        return True

    def round_trip_s(self, robot: str, now_ns: int) -> float | None:
        """From our heartbeat to the echo, without the time the robot kept it; None without a recent echo."""
        round_trip_s, at_ns = self._round_trips.get(robot, (None, 0))
        return round_trip_s if now_ns - at_ns <= _ECHO_WITHIN_NS else None


class Robot:
    """One robot by its messages; its newest `mode` arrived at `received_ns`, monotonic."""

    def __init__(self, robot: str, mode: ModeReport, received_ns: int) -> None:
        self.robot = robot
        self.mode = mode
        self.received_ns = received_ns
        self.is_alive = True
        self.turns: deque[int] = deque(maxlen=_TURNS)
        self.next_dispute_ns = 0
        self._newest: dict[type, tuple[RobotMessage, int]] = {}

    @property
    def is_active(self) -> bool:
        """Whether it accepts set-points."""
        return self.is_alive and self.mode.mode in ACTIVE

    def is_disputed(self, now_ns: int) -> bool:
        """Whether another node may have published the newest `mode`; see `ModeReport.is_out_of_turn`."""
        return bool(self.turns) and now_ns - self.turns[-1] < _DISPUTED_NS

    def age_s(self, now_ns: int) -> float:
        """Since its last message on `mode`, s."""
        return max(now_ns - self.received_ns, 0) * 1e-9

    def keep(self, message: RobotMessage, at_ns: int) -> None:
        """Keep the newest of each kind."""
        self._newest[type(message)] = (message, at_ns)

    def newest(self, kind: type[H], now_ns: int) -> H | None:
        """The newest message of a kind; None where it is too old."""
        message, at_ns = self._newest.get(kind, (None, 0))
        is_fresh = self.is_alive and now_ns - at_ns <= _FRESH_NS[kind]
        return message if isinstance(message, kind) and is_fresh else None

    def view(self, now_ns: int, beats: Heartbeats) -> RobotView:
        """The picture; of a lost robot only its last mode and why, for no number of it is valid any more."""
        mode, alive = self.mode, self.is_alive
        odometry = self.newest(Odometry, now_ns)
        setpoint = None  # the one in force: none where it accepts none, and zero in HOLD
        if self.is_active:
            setpoint = _NOT_DRIVEN if mode.mode is Mode.HOLD else self.newest(SetpointReport, now_ns)
        pitch, supply = self.newest(Pitch, now_ns), self.newest(Supply, now_ns)
        health = self.newest(Health, now_ns) or Health({}, {}, {})
        return RobotView(
            robot=self.robot,
            name=mode.name,
            is_alive=alive,
            age_s=self.age_s(now_ns),
            round_trip_s=beats.round_trip_s(self.robot, now_ns) if alive else None,
            mode=mode.mode,
            reason=mode.reason,
            drives=mode.drives,
            is_zero=mode.is_zero if alive else None,
            pitch=finite(pitch.pitch) if pitch else None,
            linear_velocity=odometry.linear_velocity if odometry else None,
            angular_velocity=odometry.angular_velocity if odometry else None,
            linear_setpoint=finite(setpoint.linear) if setpoint else None,
            angular_setpoint=finite(setpoint.angular) if setpoint else None,
            x=odometry.x if odometry else None,
            y=odometry.y if odometry else None,
            heading=odometry.heading if odometry else None,
            supply_v=finite(supply.volts) if supply else None,
            checklist=health.checklist,
            links=health.links,
            timing=health.timing,
            tilt_limit_rad=health.tilt_limit_rad,
            down_rad=health.down_rad,
            can_stand=mode.can_stand,
            posture=mode.posture or "",
        )


class Fleet:
    """Every robot that was ever received and not dismissed, by namespace."""

    def __init__(self, events: EventLog) -> None:
        """Begin with none; log changes of mode to `events`."""
        self.robots: dict[str, Robot] = {}
        self._events = events

    def update(self, name: str, message: RobotMessage, at_ns: int) -> None:
        """Keep a robot's message, which arrived at `at_ns`, monotonic; it is known from its first mode on."""
        robot = self.robots.get(name)
        if not isinstance(message, ModeReport):
            if robot is not None:
                robot.keep(message, at_ns)
            return
        text = f"{state_text(message.mode, message.posture)}: {message.reason}"
        if robot is None:
            if len(self.robots) >= MOST_ROBOTS:
                return
            self.robots[name] = Robot(name, message, at_ns)
            text = f"found {message.name}: {text}"
        else:
            if message.is_out_of_turn:
                self._note_turn(robot, at_ns)
            before, age_s = robot.mode, robot.age_s(at_ns)
            robot.mode, robot.received_ns = message, max(at_ns, robot.received_ns)
            if not robot.is_alive:
                robot.is_alive = True
                text = f"back after {age_s:.1f} s: {text}"
            elif (before.mode, before.posture, before.reason) == (message.mode, message.posture, message.reason):
                return
        self._events.add(name, text, level=_LEVELS.get(message.mode, "info"))

    def _note_turn(self, robot: Robot, at_ns: int) -> None:
        """Log, once in a while, that two nodes publish a robot's `mode`; a robot that is started anew turns once."""
        robot.turns.append(at_ns)
        is_steady = len(robot.turns) == _TURNS and at_ns - robot.turns[0] < _TURNS * _DISPUTED_NS
        if is_steady and at_ns >= robot.next_dispute_ns:
            robot.next_dispute_ns = at_ns + _DISPUTE_AGAIN_NS
            text = (
                "more than one node publishes mode here: what is shown may be another's, and no stop is confirmed by it"
            )
            self._events.add(robot.robot, text, level="error")

    def dismiss(self, name: str) -> None:
        """Forget a robot until it is received again, as one that was never found."""
        self.robots.pop(name, None)

    def mark_lost(self, now_ns: int) -> None:
        """Mark the robots of which nothing arrives any more as lost."""
        for robot in self.robots.values():
            if robot.is_alive and now_ns - robot.received_ns > _LOST_AFTER_NS:
                robot.is_alive = False
                self._events.add(robot.robot, "lost: no messages any more", level="error")
