# SPDX-License-Identifier: MIT
"""A manoeuvre: segments of constant set-points, when each has to be sent, and what plays them.

The player follows the robot only through what the robot publishes, and knows no ROS.
"""

import enum
import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec

from segway_ecc.firmware_io.clock import NS_PER_S, Clock
from segway_ecc.node.cycle.interfaces import Inbox, NoStage, Report, StampedSetpoint
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.cycle.wiring import ODOMETRY_SIGNALS
from segway_ecc.node.documents import decode_yaml
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.safety.modes import ACTIVE

RENEW_NS: Final = 100_000_000
"""A set-point that stays the same is sent again this often, well within a robot's time-out."""

LEAD_NS: Final = 500_000_000

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

    segments: Annotated[tuple[Segment, ...], msgspec.Meta(min_length=1)]

    @property
    def duration_ns(self) -> int:
        """Length of the whole manoeuvre, ns."""
        return sum(_ns(segment.duration) for segment in self.segments)


class TimedSetpoint(NamedTuple):
    """A set-point and when it is for, ns since the start of the manoeuvre."""

    offset_ns: int
    setpoint: Setpoint


def load_manoeuvre(path: str) -> Manoeuvre:
    """Read a manoeuvre from a YAML file with a list of `segments`.

    Raises:
        ConfigurationError: The file is missing or not as it must be.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(f"cannot read sequence file '{path}': {reason}") from error
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


def schedule(manoeuvre: Manoeuvre) -> Iterator[TimedSetpoint]:
    """Every set-point to send, in order: each segment's set-point at its start and renewed, rest at the end."""
    start_ns = 0
    for segment in manoeuvre.segments:
        end_ns = start_ns + _ns(segment.duration)
        setpoint = Setpoint(segment.linear, segment.angular)
        for offset_ns in range(start_ns, end_ns, RENEW_NS):
            yield TimedSetpoint(offset_ns, setpoint)
        start_ns = end_ns
    yield TimedSetpoint(start_ns, REST)


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

    RUNNING = enum.auto()
    DONE = enum.auto()


@dataclass(slots=True)
class Player:
    """Turns the robot's stamps into set-points to send, and keeps the odometry received meanwhile.

    Time is the robot's own: the manoeuvre starts a lead after the first stamp seen, and every set-point is stamped
    relative to that start. So durations are counted in model time, and delays on the way change nothing.

    Attributes:
        lead_ns: How far ahead of the robot's time set-points are stamped; far more than any delay on the way.
        start_ns: Stamp of the start; None until the first odometry.
        received: The robot's odometry from the start to the end of the manoeuvre.
    """

    manoeuvre: Manoeuvre
    lead_ns: int = LEAD_NS
    start_ns: int | None = None
    received: list[Odometry] = field(default_factory=list)
    _pending: Iterator[TimedSetpoint] = field(init=False)
    _next: TimedSetpoint | None = field(init=False)
    _sent_ahead: list[TimedSetpoint] = field(default_factory=list)
    _latest_ns: int = 0

    def __post_init__(self) -> None:
        self._pending = schedule(self.manoeuvre)
        self._next = next(self._pending)

    @property
    def end_ns(self) -> int | None:
        """Stamp of the end; None until the first odometry."""
        return None if self.start_ns is None else self.start_ns + self.manoeuvre.duration_ns

    @property
    def fraction(self) -> float:
        """How much of the manoeuvre has passed, 0 to 1."""
        if self.start_ns is None:
            return 0.0
        return min(max((self._latest_ns - self.start_ns) / self.manoeuvre.duration_ns, 0.0), 1.0)

    def update(self, odometry: Odometry) -> PlayState:
        """Receive the robot's newest odometry."""
        self._latest_ns = odometry.stamp_ns
        if self.start_ns is None:
            self.start_ns = odometry.stamp_ns + self.lead_ns
        end_ns = self.start_ns + self.manoeuvre.duration_ns
        if self.start_ns <= odometry.stamp_ns <= end_ns:
            self.received.append(odometry)
        return PlayState.DONE if odometry.stamp_ns >= end_ns else PlayState.RUNNING

    def due_setpoints(self) -> list[TimedSetpoint]:
        """The set-points to send now; their offsets are from `start_ns`."""
        if self.start_ns is None:
            return []
        due = []
        while self._next is not None and self.start_ns + self._next.offset_ns <= self._latest_ns + self.lead_ns:
            due.append(self._next)
            self._next = next(self._pending, None)
        now_ns = self._latest_ns - self.start_ns
        self._sent_ahead = [s for s in self._sent_ahead if s.offset_ns >= now_ns] + due
        return due

    def unconfirmed(self, confirmed: Collection[int]) -> int:
        """How many set-points the robot did not bring into force in their own cycle, by the stamps it confirmed."""
        if self.start_ns is None:
            return 0
        return sum(self.start_ns + timed.offset_ns not in confirmed for timed in schedule(self.manoeuvre))

    def abandon(self) -> list[TimedSetpoint]:
        """What to send to stop now: rest at once, and in place of everything that was sent ahead."""
        if self.start_ns is None:
            return []
        self._next = None
        now_ns = self._latest_ns - self.start_ns
        return [TimedSetpoint(now_ns, REST), *(TimedSetpoint(s.offset_ns, REST) for s in self._sent_ahead)]


class ManoeuvreStage(NoStage):
    """Sequence control without ROS: a stage that plays a manoeuvre once the robot is armed, and then ends; see `Stage`.

    Attributes:
        is_broken_off: Whether the robot disarmed before the end.
        started_wall_ns: The wall clock in the cycle that has the stamp of the start; None until then. The stamps
            count model time: where deadlines were skipped before the start, they are behind the wall clock.
    """

    def __init__(self, player: Player, signals: Sequence[str], clock: Clock) -> None:
        """Play to a robot that publishes `signals`; those of the odometry that it lacks count as zero."""
        self.player = player
        self._indices = [signals.index(name) if name in signals else None for name in ODOMETRY_SIGNALS]
        self.over: str | None = None
        self.is_broken_off = False
        self.started_wall_ns: int | None = None
        self._clock = clock

    def take_inbox(self) -> Inbox:
        """The set-points that are to be sent now."""
        inbox = Inbox()
        start_ns = self.player.start_ns or 0
        inbox.setpoints += [StampedSetpoint(s.setpoint, start_ns + s.offset_ns) for s in self.player.due_setpoints()]
        return inbox

    def publish(self, report: Report) -> None:
        """Pass the robot's odometry to the player."""
        if report.mode not in ACTIVE:
            if self.player.start_ns is not None:
                self.over = "the robot left the sequence"
                self.is_broken_off = True
        else:
            values = [0.0 if index is None else report.values[index] for index in self._indices]
            if self.player.update(Odometry(report.stamp_ns, *values)) is PlayState.DONE:
                self.over = "the sequence is over"
            if self.started_wall_ns is None and self.player.received:
                self.started_wall_ns = self._clock.wall_ns()


def _ns(seconds: float) -> int:
    return max(round(seconds * NS_PER_S), 1)


def _check_finite(segments: Sequence[Segment], where: str) -> None:
    for index, segment in enumerate(segments):
        values = {"linear": segment.linear, "angular": segment.angular, "duration": segment.duration}
        for name, value in values.items():
            if not math.isfinite(value):
                raise ConfigurationError(f"{where}: {name} of segment {index} is {value}; it must be finite")
