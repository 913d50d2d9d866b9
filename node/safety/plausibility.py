# SPDX-License-Identifier: MIT
"""Values that cannot be what the robot does: frozen, or against each other."""

from collections import deque
from collections.abc import Sequence
from operator import itemgetter
from typing import Final

from segway_ecc.node.safety.check import Check, Signal, View, periods_in
from segway_ecc.node.safety.settings import VelocityConsistency, YawConsistency

MOVING: Final = 0.5
"""A wheel that turns faster than this moves, rad/s: an encoder of 128 counts shows it within 0.1 s."""

_LAG_PERIODS: Final = 2
"""A velocity may be this many periods older than the angle: while the wheel speeds up, that makes them differ."""


class Frozen(Check):
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
        self._pick = itemgetter(*indices)
        self._allowed = periods
        self._wheels = None if wheels is None else tuple(wheels)
        self._last: object = None
        self._held = 0

    def look(self, view: View) -> str | None:
        """See `Check`."""
        if not view.has(self.needs):
            self._last, self._held = None, 0
            return None
        values: object = self._pick(view.values)
        repeats = values == self._last
        if repeats and self._wheels is not None:  # it may, unless one of them moves
            repeats = True in [abs(view.values[wheel]) > MOVING for wheel in self._wheels]  # any() takes longer
        self._held = self._held + view.periods if repeats else 0
        self._last = values
        if self._held < self._allowed:
            return None
        return f"{self._name} is frozen: {self._held} periods without a change"


class YawAgreement(Check):
    """The wheels' and the gyro's yaw rates, not too different for too long; see `Check`."""

    def __init__(self, left: int, right: int, gyro_z: int, settings: YawConsistency, period_s: float) -> None:
        """Compare the wheel velocities with the gyro, which are at these places."""
        self.needs: tuple[int, ...] = (left, right, gyro_z)
        self._left, self._right, self._gyro_z = left, right, gyro_z
        self._per_wheel_speed = settings.wheel_radius / settings.track
        self._tolerance = settings.tolerance_rad_s
        self._allowed = periods_in(settings.for_s, period_s)
        self._held = 0

    def look(self, view: View) -> str | None:
        """See `Check`."""
        if not view.has(self.needs):
            self._held = 0
            return None
        values = view.values
        gyro = values[self._gyro_z]
        wheels = (values[self._right] - values[self._left]) * self._per_wheel_speed
        agrees = abs(wheels - gyro) <= self._tolerance
        self._held = 0 if agrees else self._held + view.periods
        if self._held < self._allowed:
            return None
        return f"the wheels turn the robot at {wheels:.2f} rad/s, the gyro reads {gyro:.2f} rad/s"


_Sample = tuple[int, float, float, float, float]
"""When a wheel was seen, in periods and in s; its angle, its velocity, and how far that alone would have brought it."""


class VelocityAgreement(Check):
    """A wheel's velocity and the change of its angle, alike over a window; see `Check`.

    What repeats bit for bit though the wheel moves is no new sample: either the robot passes to its other line, or the
    encoder is frozen, which `Frozen` is for.
    """

    def __init__(self, angle: Signal, velocity: Signal, settings: VelocityConsistency, period_s: float) -> None:
        """Compare the two signals."""
        self.needs: tuple[int, ...] = (angle.index, velocity.index)
        self._angle, self._velocity = angle.index, velocity.index
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
        angle, velocity = view.values[self._angle], view.values[self._velocity]
        if not self._samples:
            self._samples.append((self._now, self._now_s, angle, velocity, angle))
            return None
        _, last_s, last_angle, last_velocity, travelled = self._samples[-1]
        if (angle, velocity) == (last_angle, last_velocity) and abs(velocity) > MOVING:
            return None
        travelled += 0.5 * (last_velocity + velocity) * (self._now_s - last_s)
        self._samples.append((self._now, self._now_s, angle, velocity, travelled))
        return self._compare(angle, velocity, travelled)

    def _compare(self, angle: float, velocity: float, travelled: float) -> str | None:
        """Discard what is older than it has to be, and compare the newest sample, of now, with the oldest."""
        samples = self._samples
        while self._now - samples[1][0] >= self._window:
            samples.popleft()
        then, _, old_angle, old_velocity, old_travelled = samples[0]
        span = self._now - then
        if span < self._window:
            return None
        off = ((angle - old_angle) - (travelled - old_travelled)) / (span * self._period_s)
        if abs(off) <= self._tolerance + abs(velocity - old_velocity) * _LAG_PERIODS / span:
            return None
        return f"{self._velocity_name} is off by {-off:.2f} rad/s from how {self._angle_name} changes"
