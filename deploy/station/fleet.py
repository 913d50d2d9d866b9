"""What was heard of each robot, and the picture that it makes. Pure: time is given."""

from typing import Final, TypeVar

from segway_ecc.deploy.station.discovery import MOST_ROBOTS
from segway_ecc.deploy.station.events import EventLog
from segway_ecc.deploy.station.heartbeats import Heartbeats
from segway_ecc.deploy.station.robot_messages import (
    Health,
    ModeReport,
    Pitch,
    RobotMessage,
    SetpointReport,
    Supply,
    finite,
)
from segway_ecc.deploy.station.views import RobotView
from segway_ecc.node.safety.modes import ACTIVE, Mode
from segway_ecc.node.sequence.player import Odometry

LOST_AFTER_NS: Final = 1_000_000_000
_FRESH_NS: Final[dict[type, int]] = {
    Odometry: 1_000_000_000,
    SetpointReport: 1_000_000_000,
    Pitch: 1_000_000_000,
    Supply: 10_000_000_000,
    Health: 5_000_000_000,
}
"""How long what was heard is shown; an older value is not known any more."""
_NOT_DRIVEN: Final = SetpointReport(0, 0.0, 0.0)
_LEVELS: Final = {Mode.FAULT: "error", Mode.HOLD: "warning"}
H = TypeVar("H")


class Robot:
    """One robot as it was heard.

    Attributes:
        robot: Its namespace.
        mode: Its newest word on the topic `mode`.
        heard_ns: When that came.
        is_alive: Whether it came lately.
    """

    def __init__(self, robot: str, mode: ModeReport, heard_ns: int) -> None:
        """Begin with the first word."""
        self.robot = robot
        self.mode = mode
        self.heard_ns = heard_ns
        self.is_alive = True
        self._newest: dict[type, tuple[RobotMessage, int]] = {}

    @property
    def is_active(self) -> bool:
        """Whether it takes set-points."""
        return self.is_alive and self.mode.mode in ACTIVE

    def age_s(self, now_ns: int) -> float:
        """Since its last word, s."""
        return max(now_ns - self.heard_ns, 0) * 1e-9

    def keep(self, heard: RobotMessage, at_ns: int) -> None:
        """Keep the newest of each kind."""
        self._newest[type(heard)] = (heard, at_ns)

    def newest(self, kind: type[H], now_ns: int) -> H | None:
        """What was last heard of a kind; None where that was too long ago."""
        heard, at_ns = self._newest.get(kind, (None, 0))
        is_fresh = self.is_alive and now_ns - at_ns <= _FRESH_NS[kind]
        return heard if isinstance(heard, kind) and is_fresh else None

    def view(self, now_ns: int, beats: Heartbeats) -> RobotView:
        """The picture; of a lost robot only what it last was and why, for no number of it is true any more."""
        mode, alive = self.mode, self.is_alive
        odometry = self.newest(Odometry, now_ns)
        setpoint = self._setpoint(now_ns)
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
            can_stand=mode.can_stand,
        )

    def _setpoint(self, now_ns: int) -> SetpointReport | None:
        """What is in force: none while it takes none, and zero while it holds."""
        if not self.is_active:
            return None
        return _NOT_DRIVEN if self.mode.mode is Mode.HOLD else self.newest(SetpointReport, now_ns)


class Fleet:
    """Every robot that was heard.

    Attributes:
        robots: By namespace.
    """

    def __init__(self, events: EventLog) -> None:
        """Begin with none; tell `events` what happens."""
        self.robots: dict[str, Robot] = {}
        self._events = events

    def hear(self, name: str, heard: RobotMessage, at_ns: int) -> None:
        """Take what a robot said; it is known from its first mode on.

        Args:
            name: Its namespace.
            heard: What it said.
            at_ns: When that reached us, monotonic.
        """
        robot = self.robots.get(name)
        if not isinstance(heard, ModeReport):
            if robot is not None:
                robot.keep(heard, at_ns)
        elif robot is not None:
            self._hear_mode(robot, heard, at_ns)
        elif len(self.robots) < MOST_ROBOTS:
            self.robots[name] = Robot(name, heard, at_ns)
            self._tell_mode(name, f"found {heard.name}: {heard.mode}: {heard.reason}", heard)

    def look(self, now_ns: int) -> None:
        """See who is lost."""
        for robot in self.robots.values():
            if robot.is_alive and now_ns - robot.heard_ns > LOST_AFTER_NS:
                robot.is_alive = False
                self._events.add(robot.robot, "lost: it says nothing any more", level="error")

    def _hear_mode(self, robot: Robot, mode: ModeReport, at_ns: int) -> None:
        before, age_s = robot.mode, robot.age_s(at_ns)
        robot.mode, robot.heard_ns = mode, max(at_ns, robot.heard_ns)
        if not robot.is_alive:
            robot.is_alive = True
            self._tell_mode(robot.robot, f"back after {age_s:.1f} s: {mode.mode}: {mode.reason}", mode)
        elif (before.mode, before.reason) != (mode.mode, mode.reason):
            self._tell_mode(robot.robot, f"{mode.mode}: {mode.reason}", mode)

    def _tell_mode(self, name: str, text: str, mode: ModeReport) -> None:
        self._events.add(name, text, level=_LEVELS.get(mode.mode, "info"))
