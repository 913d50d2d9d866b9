# SPDX-License-Identifier: MIT
"""Set-points: which one is in force, which ones wait for their time, and which were refused."""

import enum
import heapq
import math
from collections import Counter
from typing import Final, NamedTuple

CAPACITY: Final = 4096
"""Set-points that may wait at once."""


class Setpoint(NamedTuple):
    """What the robot is asked to do: linear velocity ahead, m/s, and angular velocity counter-clockwise, rad/s."""

    linear_velocity: float
    angular_velocity: float


REST: Final = Setpoint(0.0, 0.0)
NO_LIMIT: Final = Setpoint(math.inf, math.inf)


@enum.unique
class SetpointRefusal(enum.StrEnum):
    """Why a set-point was not taken; the last good one stays in force."""

    NOT_FINITE = "not_finite"
    TOO_LARGE = "too_large"
    OUT_OF_RANGE = "out_of_range"
    """A value that is set, beyond the range of what it is wired to."""
    REFUSED_BY_MODEL = "refused_by_model"
    """A value that is set, and that the state it is wired to does not take."""
    STALE = "stale"
    TOO_FAR_AHEAD = "too_far_ahead"
    QUEUE_FULL = "queue_full"
    NOT_ARMED = "not_armed"
    FOLLOWS_TRAJECTORY = "follows_trajectory"
    """It came while a whole trajectory was followed, which nothing but another one changes."""
    MALFORMED = "malformed"
    """A trajectory whose points make none."""


class SetpointSchedule:
    """Set-points in order of the cycle they are for.

    Attributes:
        refused: How many were refused, by cause.
        late: How many came after their cycle but within the tolerance, and were applied on arrival.
        applied: How many came into force.
        clamped: How many asked for more than the largest, and were taken with that.
    """

    def __init__(
        self,
        timeout_cycles: int,
        tolerance_cycles: int,
        horizon_cycles: int,
        largest: Setpoint = NO_LIMIT,
        *,
        clamps: bool = False,
    ) -> None:
        """Set the limits.

        Args:
            timeout_cycles: Silence before a hold.
            tolerance_cycles: Lateness still taken.
            horizon_cycles: How far ahead is taken.
            largest: Largest magnitudes that are taken; what asks for more is refused, for no robot was meant to do it.
            clamps: Whether it is taken with the largest instead, each velocity by itself.
        """
        self._largest = largest
        self._clamps = clamps
        self.clamped = 0
        self.refused: Counter[SetpointRefusal] = Counter()
        self.late = 0
        self.applied = 0
        self._timeout = timeout_cycles
        self._tolerance = tolerance_cycles
        self._horizon = horizon_cycles
        self._waiting: list[tuple[int, int, Setpoint]] = []
        self._order = 0
        self._ahead_until = -timeout_cycles - 1
        self._current = REST
        self._applied_at: int | None = None

    def is_idle(self, now: int) -> bool:
        """Whether nothing waits for its cycle, nor has for as long as the time-out: no manoeuvre is being played."""
        return not self._waiting and now > self._ahead_until + self._timeout

    def add(self, setpoint: Setpoint, cycle: int, now: int) -> SetpointRefusal | None:
        """Take a set-point for `cycle`, being in cycle `now`; return why it was refused, if it was."""
        taken = self._clamped(setpoint) if self._clamps else setpoint
        refusal = self._refusal(taken, cycle, now)
        if refusal is not None:
            self.refuse(refusal)
            return refusal
        self.clamped += taken != setpoint
        if cycle < now:
            self.late += 1
        elif cycle > now:
            self._ahead_until = max(self._ahead_until, cycle)
        self._order += 1
        heapq.heappush(self._waiting, (max(cycle, now), self._order, taken))
        return None

    def refuse(self, refusal: SetpointRefusal) -> None:
        """Count a set-point that the caller refused."""
        self.refused[refusal] += 1

    def due(self, now: int) -> Setpoint:
        """Bring into force what is due in cycle `now`; return the set-point in force."""
        while self._waiting and self._waiting[0][0] <= now:
            _, _, self._current = heapq.heappop(self._waiting)
            self._applied_at = now
            self.applied += 1
        return self._current

    def follow(self, setpoint: Setpoint, now: int) -> Setpoint:
        """Bring a trajectory's set-point of cycle `now` into force; what waited for its time is discarded."""
        self._waiting.clear()
        self.applied += setpoint != self._current
        self._current, self._applied_at = setpoint, now
        return setpoint

    def came_into_force(self, now: int) -> bool:
        """Whether the set-point in force is one of cycle `now`."""
        return self._applied_at == now

    def is_silent(self, now: int) -> bool:
        """Whether a set-point is in force that was not renewed for longer than the time-out."""
        return self._applied_at is not None and now - self._applied_at > self._timeout

    def clear(self) -> None:
        """Discard everything that is in force or waits."""
        self._waiting.clear()
        self._current = REST
        self._applied_at = None

    def _clamped(self, setpoint: Setpoint) -> Setpoint:
        """The nearest that is allowed; what is not finite stays so."""
        linear, angular = setpoint
        most_linear, most_angular = self._largest
        if not (math.isfinite(linear) and math.isfinite(angular)):
            return setpoint
        return Setpoint(
            max(min(linear, most_linear), -most_linear),
            max(min(angular, most_angular), -most_angular),
        )

    def _refusal(self, setpoint: Setpoint, cycle: int, now: int) -> SetpointRefusal | None:
        linear, angular = setpoint.linear_velocity, setpoint.angular_velocity
        if not (math.isfinite(linear) and math.isfinite(angular)):
            return SetpointRefusal.NOT_FINITE
        if abs(linear) > self._largest.linear_velocity or abs(angular) > self._largest.angular_velocity:
            return SetpointRefusal.TOO_LARGE
        if cycle < now - self._tolerance:
            return SetpointRefusal.STALE
        if cycle > now + self._horizon:
            return SetpointRefusal.TOO_FAR_AHEAD
        if len(self._waiting) >= CAPACITY:
            return SetpointRefusal.QUEUE_FULL
        return None
