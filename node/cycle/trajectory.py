# SPDX-License-Identifier: MIT
"""A trajectory: a whole manoeuvre, taken before it begins and followed from the robot's own clock.

It is the content of a trajectory_msgs/MultiDOFJointTrajectory on `cmd_trajectory`. A point's velocity holds until the
next point's time; the last point is the end, where the robot is to rest.
"""

import enum
import itertools
import math
import operator
import struct
import zlib
from collections import deque
from typing import Final, NamedTuple

from segway_ecc.node.cycle.setpoints import REST, Setpoint, SetpointRefusal
from segway_ecc.node.cycle.timing import TimeBase

MOST_POINTS: Final = 1000
"""Of one trajectory: so many pass through the rings to the loop and to the log in one message."""
TOO_LATE: Final = "it came too late"
"""Begins the reason of a refusal after which the same may be sent again with a later start."""
LONGEST_REASON: Final = 200
"""In characters: it is reported in every cycle."""
_MOST_UNREPORTED: Final = 100
"""Refusals that wait to be reported; where a flood of them does not end, the oldest is discarded."""


class TimedSetpoint(NamedTuple):
    """A set-point and when it comes into force, ns since the start of its trajectory."""

    offset_ns: int
    setpoint: Setpoint


class Trajectory(NamedTuple):
    """What arrived.

    Attributes:
        stamp_ns: When it is to begin, ns since the Unix epoch by the robot's stamps; 0 means at once.
        points: Set-points in the order of their times; none of them cancels the trajectory that is followed.
        unsupported: What its message asks for that no robot does, for which it is refused; empty for nothing.
    """

    stamp_ns: int
    points: tuple[TimedSetpoint, ...]
    unsupported: str = ""

    @property
    def digest(self) -> int:
        """CRC-32 of stamp and points, little-endian: by stamp and digest a sender knows its own among others'."""
        numbers = [number for offset_ns, setpoint in self.points for number in (offset_ns, *setpoint)]
        return zlib.crc32(struct.pack(f"<q{'qdd' * len(self.points)}", self.stamp_ns, *numbers))


CANCEL: Final = Trajectory(0, ())


@enum.unique
class TrajectoryState(enum.StrEnum):
    """What became of a trajectory."""

    NONE = "none"
    """There was none yet."""
    ACCEPTED = "accepted"
    """It was taken whole and waits for its start."""
    FOLLOWED = "followed"
    DONE = "done"
    ABORTED = "aborted"
    REFUSED = "refused"


class TrajectoryStatus(NamedTuple):
    """A trajectory and what became of it.

    Attributes:
        stamp_ns: The stamp that it came with.
        state: What became of it.
        reason: Why it was refused or aborted; empty otherwise.
        start_ns: Stamp of the cycle in which it begins, ns; 0 where it was refused.
        end_ns: Stamp of the cycle in which it ends, ns; 0 where it was refused.
        cycles: From the one to the other; 0 where it was refused.
        digest: That of the trajectory; 0 where there was none.
    """

    stamp_ns: int
    state: TrajectoryState
    reason: str
    start_ns: int
    end_ns: int
    cycles: int = 0
    digest: int = 0


class Objection(NamedTuple):
    """Why a trajectory is refused: the cause that is counted, and the text for who sent it."""

    cause: SetpointRefusal
    text: str


def cycle_at(offset_ns: int, period_ns: int) -> int:
    """The cycle, counted from the start, in which a point of this time comes into force: the nearest."""
    return (offset_ns + period_ns // 2) // period_ns


def objection(points: tuple[TimedSetpoint, ...], largest: Setpoint, period_ns: int) -> Objection | None:
    """What is wrong with the points themselves; None where nothing is.

    Args:
        points: At least one.
        largest: Largest magnitudes that are taken.
        period_ns: Of the robot's cycles.
    """
    if len(points) > MOST_POINTS:
        return Objection(SetpointRefusal.MALFORMED, f"it is larger than {MOST_POINTS} points may be")
    # In C as far as it goes: a thousand points are checked within one cycle.
    offsets, setpoints = zip(*points, strict=True)
    numbers = [number for setpoint in setpoints for number in setpoint]
    if not all(map(math.isfinite, numbers)):
        place = next(place for place, number in enumerate(numbers) if not math.isfinite(number))
        return Objection(SetpointRefusal.NOT_FINITE, f"the velocity of point {place // 2} is missing or not finite")
    for values, limit, unit in zip((numbers[::2], numbers[1::2]), largest, ("m/s", "rad/s"), strict=True):
        fastest = max(map(abs, values))
        if fastest > limit:
            text = f"it asks for {fastest:g} {unit}; at most {limit:g} {unit} is allowed"
            return Objection(SetpointRefusal.TOO_LARGE, text)
    cycles = [cycle_at(offset_ns, period_ns) for offset_ns in offsets]
    text = ""
    if offsets[0] < 0 or not all(map(operator.lt, offsets, offsets[1:])):
        text = "the times of its points do not increase from 0 s on"
    elif setpoints[-1] != REST:
        text = "its last point, which is its end, is not at rest"
    elif len(set(cycles)) < len(cycles):
        first = next(place for place, (one, other) in enumerate(itertools.pairwise(cycles)) if one == other)
        text = f"points {first} and {first + 1} fall into one cycle, of {period_ns * 1e-9:g} s: one would not be driven"
    return Objection(SetpointRefusal.MALFORMED, text) if text else None


class TrajectoryFollower:
    """Takes trajectories, each whole or not at all, and follows one at a time.

    A new one takes the place of the one that is followed. A velocity holds until the next point, however long nothing
    else arrives; what ends a trajectory early is a new one, an empty one, and leaving ARMED.

    Attributes:
        is_active: Whether a trajectory is followed, or waits for its start.
        status: The newest trajectory that was accepted.
        refused: Those that were refused and not reported yet, the oldest first.
    """

    def __init__(self, time_base: TimeBase, largest: Setpoint, horizon_cycles: int) -> None:
        """Follow nothing yet.

        Args:
            time_base: The stamps of the cycles.
            largest: Largest magnitudes that are taken.
            horizon_cycles: How far ahead a trajectory may begin.
        """
        self.status = TrajectoryStatus(0, TrajectoryState.NONE, "", 0, 0)
        self.refused: deque[TrajectoryStatus] = deque(maxlen=_MOST_UNREPORTED)
        self._time_base = time_base
        self._largest = largest
        self._horizon = horizon_cycles
        self._accepted = CANCEL
        self.is_active = False
        self._passed = 0
        self._start = 0

    def take(self, trajectory: Trajectory, now: int, *, is_armed: bool) -> SetpointRefusal | None:
        """Accept a trajectory in cycle `now`, or refuse it; return the cause where it was refused."""
        stamp_ns, points, _ = trajectory
        if not points:
            self.abort("the trajectory was cancelled")
            return None
        if stamp_ns and trajectory == self._accepted:
            return None  # sent again by who had no answer
        start = self._time_base.cycle_of(stamp_ns) if stamp_ns else now
        found = self._objection(trajectory, start, now, is_armed=is_armed)
        if found is not None:
            text = found.text[:LONGEST_REASON]
            refused = TrajectoryStatus(stamp_ns, TrajectoryState.REFUSED, text, 0, 0, digest=trajectory.digest)
            self.refused.append(refused)
            return found.cause
        self._accepted, self.is_active, self._passed, self._start = trajectory, True, 0, start
        start_ns = self._time_base.stamp_ns(start)
        end = self._cycle_of(points[-1])
        end_ns, digest = self._time_base.stamp_ns(end), trajectory.digest
        self.status = TrajectoryStatus(stamp_ns, TrajectoryState.ACCEPTED, "", start_ns, end_ns, end - start, digest)
        return None

    def due(self, now: int) -> Setpoint | None:
        """The set-point of the trajectory in cycle `now`; None where none is followed."""
        points = self._accepted.points
        if not self.is_active or now < self._start:
            return None
        while self._passed < len(points) and self._cycle_of(points[self._passed]) <= now:
            self._passed += 1
        if self._passed == len(points):
            self._end(TrajectoryState.DONE)
        elif self.status.state is TrajectoryState.ACCEPTED:
            self.status = self.status._replace(state=TrajectoryState.FOLLOWED)
        return points[self._passed - 1].setpoint if self._passed else REST

    def abort(self, reason: str) -> bool:
        """End the trajectory early; return whether there was one."""
        was_active = self.is_active
        if was_active:
            self._end(TrajectoryState.ABORTED, reason)
        return was_active

    def _end(self, state: TrajectoryState, reason: str = "") -> None:
        self.is_active = False
        self.status = self.status._replace(state=state, reason=reason[:LONGEST_REASON])

    def _cycle_of(self, point: TimedSetpoint) -> int:
        return self._start + cycle_at(point.offset_ns, self._time_base.period_ns)

    def _objection(self, trajectory: Trajectory, start: int, now: int, *, is_armed: bool) -> Objection | None:
        if not is_armed:
            return Objection(SetpointRefusal.NOT_ARMED, "the robot is not armed")
        if trajectory.unsupported:
            return Objection(SetpointRefusal.MALFORMED, trajectory.unsupported)
        period_s = self._time_base.period_ns * 1e-9
        if start < now:
            text = f"{TOO_LATE}: it was to begin {(now - start) * period_s:.3f} s before it arrived"
            return Objection(SetpointRefusal.STALE, text)
        if start > now + self._horizon:
            text = (
                f"it is to begin in {(start - now) * period_s:.3f} s; at most {self._horizon * period_s:g} s is allowed"
            )
            return Objection(SetpointRefusal.TOO_FAR_AHEAD, text)
        return objection(trajectory.points, self._largest, self._time_base.period_ns)
