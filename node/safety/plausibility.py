"""Values that cannot be what the robot does: frozen, or against each other."""

from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from node.safety.check import Signal, View, periods_in
from node.safety.settings import VelocityConsistency, YawConsistency

MOVING: Final = 0.5
"""A wheel that turns faster than this moves, rad/s: an encoder of 128 counts shows it within 0.1 s."""

_LAG_PERIODS: Final = 2
"""A velocity may be this many periods older than the angle: while the wheel speeds up, that makes them differ."""


class Frozen:
    """A set of values that repeats bit for bit for too long; see `Check`."""

    def __init__(self, name: str, indices: Sequence[int], periods: int, wheels: Sequence[int] | None) -> None:
        """Watch the set at `indices`.

        Args:
            name: What the set is called.
            indices: The set.
            periods: How many periods it may repeat.
            wheels: Velocities of wheels; the set may repeat while none of them moves. None where it never may.
        """
        self.needs: tuple[int, ...] = (*indices, *(wheels or ()))
        self._name = name
        self._indices = tuple(indices)
        self._allowed = periods
        self._wheels = wheels
        self._last: tuple[float, ...] | None = None
        self._held = 0

    def look(self, view: View) -> str | None:
        """See `Check`."""
        values = view.pick(self._indices) if view.has(self.needs) else None
        repeats = values is not None and values == self._last and self._must_change(view)
        self._held = self._held + view.periods if repeats else 0
        self._last = values
        return f"{self._name} is frozen: {self._held} periods without a change" if self._is_over else None

    @property
    def _is_over(self) -> bool:
        return self._held >= self._allowed

    def _must_change(self, view: View) -> bool:
        return self._wheels is None or any(abs(velocity) > MOVING for velocity in view.pick(self._wheels))


class YawAgreement:
    """The wheels' and the gyro's yaw rates, not too different for too long; see `Check`."""

    def __init__(self, left: int, right: int, gyro_z: int, settings: YawConsistency, period_s: float) -> None:
        """Compare the wheel velocities with the gyro, which are at these places."""
        self.needs: tuple[int, ...] = (left, right, gyro_z)
        self._per_wheel_speed = settings.wheel_radius / settings.track
        self._tolerance = settings.tolerance_rad_s
        self._allowed = periods_in(settings.for_s, period_s)
        self._held = 0

    def look(self, view: View) -> str | None:
        """See `Check`."""
        if not view.has(self.needs):
            self._held = 0
            return None
        left, right, gyro = view.pick(self.needs)
        wheels = (right - left) * self._per_wheel_speed
        agrees = abs(wheels - gyro) <= self._tolerance
        self._held = 0 if agrees else self._held + view.periods
        if self._held < self._allowed:
            return None
        return f"the wheels turn the robot at {wheels:.2f} rad/s, the gyro says {gyro:.2f} rad/s"


class _Sample(NamedTuple):
    """A wheel, when it was there, and how far its velocity alone would have brought it."""

    now: int
    now_s: float
    angle: float
    velocity: float
    travelled: float


class VelocityAgreement:
    """A wheel's velocity and the change of its angle, alike over a window; see `Check`.

    What repeats bit for bit though the wheel moves is no new sample: either the robot passes to its other line, or the
    encoder is frozen, which `Frozen` is for.
    """

    def __init__(self, angle: Signal, velocity: Signal, settings: VelocityConsistency, period_s: float) -> None:
        """Compare the two signals."""
        self.needs: tuple[int, ...] = (angle.index, velocity.index)
        self._angle_name, self._velocity_name = angle.name, velocity.name
        self._tolerance = settings.tolerance_rad_s
        self._window = periods_in(settings.for_s, period_s)
        self._period_s = period_s
        # Of the shortest span that is enough: as a sample is at least a period newer than the last, never many.
        self._samples: deque[_Sample] = deque()
        self._now = 0
        self._now_s = 0.0

    def look(self, view: View) -> str | None:
        """See `Check`."""
        if not view.has(self.needs):
            self._samples.clear()
            return None
        self._now += view.periods
        self._now_s += view.periods * self._period_s if view.elapsed_s is None else view.elapsed_s
        angle, velocity = view.pick(self.needs)
        if not self._samples:
            self._samples.append(_Sample(self._now, self._now_s, angle, velocity, angle))
            return None
        last = self._samples[-1]
        if (angle, velocity) == (last.angle, last.velocity) and abs(velocity) > MOVING:
            return None
        travelled = last.travelled + 0.5 * (last.velocity + velocity) * (self._now_s - last.now_s)
        self._samples.append(_Sample(self._now, self._now_s, angle, velocity, travelled))
        return self._compare()

    def _compare(self) -> str | None:
        """Forget what is older than it has to be, and compare the newest sample with the oldest."""
        newest = self._samples[-1]
        while newest.now - self._samples[1].now >= self._window:
            self._samples.popleft()
        oldest = self._samples[0]
        span = newest.now - oldest.now
        if span < self._window:
            return None
        change = newest.angle - oldest.angle
        off = (change - (newest.travelled - oldest.travelled)) / (span * self._period_s)
        if abs(off) <= self._tolerance + abs(newest.velocity - oldest.velocity) * _LAG_PERIODS / span:
            return None
        return f"{self._velocity_name} is off by {-off:.2f} rad/s from how {self._angle_name} changes"
