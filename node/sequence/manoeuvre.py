# SPDX-License-Identifier: MIT
"""A manoeuvre: segments of constant set-points, and what plays them.

The player follows the robot only through what the robot publishes, and knows no ROS.
"""

import enum
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec

from segway_ecc.firmware_io.clock import NS_PER_S, Clock
from segway_ecc.node.cycle.interfaces import Inbox, NoStage, Report
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.cycle.signals import ODOMETRY_SIGNALS
from segway_ecc.node.cycle.trajectory import (
    MOST_POINTS,
    TimedSetpoint,
    Trajectory,
    TrajectoryState,
    TrajectoryStatus,
)
from segway_ecc.node.documents import decode_yaml, read_document
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.safety.modes import ACTIVE

RENEW_NS: Final = 100_000_000
"""A set-point that stays the same is sent again this often, well within a robot's time-out."""

LEAD_NS: Final = 500_000_000
"""How far ahead of the robot's time a trajectory is to begin; far more than any delay on the way."""

LONGEST_S: Final = 86_400.0
"""Length of the longest segment, s."""


class Segment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Set-points held for a while.

    Attributes:
        linear: Linear velocity, m/s.
        angular: Angular velocity, rad/s, counter-clockwise positive.
        duration: How long, s of model time.
    """

    duration: Annotated[float, msgspec.Meta(gt=0.0, le=LONGEST_S)]
    linear: float = 0.0
    angular: float = 0.0


class Manoeuvre(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Segments, one after the other; at the end the set-point is zero."""

    segments: Annotated[tuple[Segment, ...], msgspec.Meta(min_length=1, max_length=MOST_POINTS - 1)]

    @property
    def duration_ns(self) -> int:
        """Length of the whole manoeuvre, ns."""
        return sum(_ns(segment.duration) for segment in self.segments)


def load_manoeuvre(path: str) -> Manoeuvre:
    """Read a manoeuvre from a YAML file with a list of `segments`.

    Raises:
        ConfigurationError: The file is missing or not as it must be.
    """
    try:
        text = read_document(Path(path))
    except OSError as error:
        raise ConfigurationError(f"cannot read sequence file '{path}': {error.strerror}") from error
    manoeuvre = decode_yaml(text, Manoeuvre, path)
    _check_finite(manoeuvre.segments, path)
    return manoeuvre


def single_segment(linear: float, angular: float, duration: float) -> Manoeuvre:
    """One segment: m/s, rad/s, s.

    Raises:
        ConfigurationError: A value is not finite or the duration not positive.
    """
    if not 0.0 < duration <= LONGEST_S:
        raise ConfigurationError(f"the duration must be more than 0 s and at most {LONGEST_S:g} s, not {duration}")
    segments = (Segment(linear=linear, angular=angular, duration=duration),)
    _check_finite(segments, "sequence")
    return Manoeuvre(segments=segments)


def points(manoeuvre: Manoeuvre) -> tuple[TimedSetpoint, ...]:
    """The manoeuvre as the points of a trajectory: each segment's set-point at its start, rest at the end."""
    found, start_ns = [], 0
    for segment in manoeuvre.segments:
        found.append(TimedSetpoint(start_ns, Setpoint(segment.linear, segment.angular)))
        start_ns += _ns(segment.duration)
    return (*found, TimedSetpoint(start_ns, REST))


def schedule(manoeuvre: Manoeuvre) -> Iterator[TimedSetpoint]:
    """Every set-point to send one by one: each segment's set-point at its start and renewed, rest at the end."""
    start_ns = 0
    for segment in manoeuvre.segments:
        end_ns = start_ns + _ns(segment.duration)
        setpoint = Setpoint(segment.linear, segment.angular)
        for offset_ns in range(start_ns, end_ns, RENEW_NS):
            yield TimedSetpoint(offset_ns, setpoint)
        start_ns = end_ns
    yield TimedSetpoint(start_ns, REST)


def start_stamp(latest_ns: int, lead_ns: int) -> int:
    """A stamp, ns, to begin at after the robot's newest: moved by up to 66 us, so that no two choose the same."""
    return latest_ns + lead_ns + int.from_bytes(os.urandom(2))


class Odometry(NamedTuple):
    """The robot's published odometry: stamp (ns since the Unix epoch), m, m, rad, m/s, rad/s."""

    stamp_ns: int
    x: float
    y: float
    heading: float
    linear_velocity: float
    angular_velocity: float


@enum.unique
class PlayState(enum.Enum):
    """How far the manoeuvre has come."""

    WAITING = enum.auto()
    """The robot has not accepted it yet."""
    RUNNING = enum.auto()
    DONE = enum.auto()
    BROKEN_OFF = enum.auto()
    REFUSED = enum.auto()


@dataclass(slots=True)
class Player:
    """A manoeuvre that travels whole: the trajectory to send, and what the robot reports of it.

    The robot plays it from its own clock. So durations are counted in model time, and nothing that happens on the way
    once it is accepted, or to whoever sent it, changes it.

    Attributes:
        manoeuvre: What is played.
        status: What the robot reported of it; None before it did.
        latest_ns: The robot's newest stamp, ns since the Unix epoch.
    """

    manoeuvre: Manoeuvre
    status: TrajectoryStatus | None = None
    latest_ns: int = 0
    _sent: tuple[int, int] | None = None
    _odometry: list[Odometry] = field(default_factory=list)

    def trajectory(self, stamp_ns: int) -> Trajectory:
        """What to send, to begin at a stamp of the robot's; what was sent before is replaced by it."""
        trajectory = Trajectory(stamp_ns, points(self.manoeuvre))
        self._sent, self.status = (stamp_ns, trajectory.digest), None
        return trajectory

    def receive_status(self, status: TrajectoryStatus) -> None:
        """Receive what the robot reports of a trajectory, whoever's it is."""
        if (status.stamp_ns, status.digest) == self._sent:
            self.status = status
        elif (
            self.status is not None and self.state is PlayState.RUNNING and status.state is not TrajectoryState.REFUSED
        ):
            reason = "another trajectory took its place"
            self.status = self.status._replace(state=TrajectoryState.ABORTED, reason=reason)

    def receive_odometry(self, odometry: Odometry) -> None:
        """Receive the robot's newest odometry."""
        self.latest_ns = odometry.stamp_ns
        self._odometry.append(odometry)

    @property
    def state(self) -> PlayState:
        """How far it has come; it is done once the robot has confirmed that, and its last odometry is here."""
        match self.status and self.status.state:
            case None:
                return PlayState.WAITING
            case TrajectoryState.REFUSED:
                return PlayState.REFUSED
            case TrajectoryState.ABORTED:
                return PlayState.BROKEN_OFF
            case TrajectoryState.DONE if self.has_reached_end:
                return PlayState.DONE
        return PlayState.RUNNING

    @property
    def start_ns(self) -> int | None:
        """Stamp of the start; None until the robot has accepted it."""
        return self.status.start_ns or None if self.status is not None else None

    @property
    def end_ns(self) -> int | None:
        """Stamp of the end; None until the robot has accepted it."""
        return self.status.end_ns or None if self.status is not None else None

    @property
    def has_reached_end(self) -> bool:
        """Whether the robot's time is that of the end, or later."""
        return self.end_ns is not None and self.end_ns <= self.latest_ns

    @property
    def is_under_way(self) -> bool:
        """Whether the robot's newest stamp is from the start on, and before the end."""
        return self.start_ns is not None and self.start_ns <= self.latest_ns and not self.has_reached_end

    @property
    def received(self) -> list[Odometry]:
        """The robot's odometry of its cycles from the start to the end of the manoeuvre."""
        start_ns, end_ns = self.start_ns, self.end_ns
        if self.status is None or start_ns is None or end_ns is None:
            return []
        stamps = range(start_ns, end_ns + 1, max((end_ns - start_ns) // max(self.status.cycles, 1), 1))
        return [each for each in self._odometry if each.stamp_ns in stamps]

    @property
    def missing(self) -> int:
        """Of how many of the robot's cycles, from start to end, no odometry arrived."""
        cycles = self.status.cycles if self.status is not None else 0
        return cycles + 1 - len({each.stamp_ns for each in self.received})

    @property
    def fraction(self) -> float:
        """How much of the manoeuvre has passed, 0 to 1."""
        if self.start_ns is None:
            return 0.0
        return min(max((self.latest_ns - self.start_ns) / self.manoeuvre.duration_ns, 0.0), 1.0)


class ManoeuvreStage(NoStage):
    """Sequence control without ROS: a stage that plays a manoeuvre once the robot is armed, and then ends; see `Stage`.

    Attributes:
        is_broken_off: Whether the robot refused it, or disarmed before the end.
        started_wall_ns: The wall clock in the cycle that has the stamp of the start; None until then. The stamps
            count model time: where deadlines were skipped before the start, they are behind the wall clock.
    """

    def __init__(self, player: Player, signals: Sequence[str], clock: Clock, lead_ns: int = LEAD_NS) -> None:
        """Play to a robot that publishes `signals`; those of the odometry that it lacks count as zero."""
        self.player = player
        self._indices = [signals.index(name) if name in signals else None for name in ODOMETRY_SIGNALS]
        self.over: str | None = None
        self.is_broken_off = False
        self.started_wall_ns: int | None = None
        self._clock = clock
        self._lead_ns = lead_ns
        self._is_sent = False

    def take_inbox(self) -> Inbox:
        """The trajectory, once."""
        inbox = Inbox()
        if self.player.latest_ns and not self._is_sent:
            self._is_sent = True
            inbox.trajectories.append(self.player.trajectory(self.player.latest_ns + self._lead_ns))
        return inbox

    def publish(self, report: Report) -> None:
        """Pass the robot's odometry, and what became of the trajectory, to the player."""
        player = self.player
        for status in filter(None, (report.trajectory, report.refused_trajectory)):
            player.receive_status(status)
        if player.state is PlayState.REFUSED and player.status is not None:
            self._break_off(f"the robot refused the sequence: {player.status.reason}")
        elif report.mode in ACTIVE and player.state is not PlayState.BROKEN_OFF:
            values = [0.0 if index is None else report.values[index] for index in self._indices]
            player.receive_odometry(Odometry(report.stamp_ns, *values))
            if player.has_reached_end:
                self.over = "the sequence is over"
            if self.started_wall_ns is None and player.start_ns and player.start_ns <= report.stamp_ns:
                self.started_wall_ns = self._clock.wall_ns()
        elif self._is_sent:
            self._break_off("the robot left the sequence")

    def _break_off(self, reason: str) -> None:
        self.over, self.is_broken_off = reason, True


def _ns(seconds: float) -> int:
    return max(round(seconds * NS_PER_S), 1)


def _check_finite(segments: Sequence[Segment], where: str) -> None:
    for index, segment in enumerate(segments):
        values = {"linear": segment.linear, "angular": segment.angular, "duration": segment.duration}
        for name, value in values.items():
            if not math.isfinite(value):
                raise ConfigurationError(f"{where}: {name} of segment {index} is {value}; it must be finite")
