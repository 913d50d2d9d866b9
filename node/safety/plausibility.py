# SPDX-License-Identifier: MIT
"""Values that cannot be what the robot does or should: out of range, frozen, against each other or the set-point."""

from collections import deque
from collections.abc import Sequence
from operator import itemgetter
from typing import Final

from segway_ecc.node.safety.check import Check, View, periods_in
from segway_ecc.node.safety.settings import (
    FollowingErrorSettings,
    RunawaySettings,
    VelocityConsistency,
    YawConsistency,
)

MOVING: Final = 0.5
"""A wheel that turns faster than this moves, rad/s: an encoder of 128 counts shows it within 0.1 s."""

_LAG_PERIODS: Final = 2
"""A velocity may be this many periods older than the angle: while the wheel speeds up, that makes them differ."""


class RangeCheck(Check):
    """A value that must lie in a window; what is not a number lies in none. See `Check`."""

    def __init__(self, name: str, index: int, low: float, high: float, unit: str) -> None:
        """Let the signal `name`, at this place, be from `low` to `high`, both in its unit."""
        self.needs: tuple[int, ...] = (index,)
        self._name = name
        self._index = index
        self._low = low
        self._high = high
        self._unit = unit

    def look(self, view: View) -> str | None:
        """See `Check`."""
        value = view.values[self._index]
        if not view.has(self.needs) or self._low <= value <= self._high:
            return None
        window = f"{self._low:g} to {self._high:g} {self._unit}"
        return f"{self._name} is {value:.2f} {self._unit}, allowed is {window}"


class WheelSpeed(RangeCheck):
    """A wheel's velocity: one that lost the floor may be faster for that moment; see `Check`."""

    def look(self, view: View) -> str | None:
        """See `Check`."""
        return None if view.spins else super().look(view)


class Frozen(Check):
    """A set of values that repeats bit for bit for too long; see `Check`."""

    def __init__(self, name: str, indices: Sequence[int], periods: int, wheels: Sequence[int] | None) -> None:
        """Watch the set at `indices`, which may repeat for so many periods.

        It may for longer while none of the `wheels`, whose velocities are at these places, moves; None: it never may.
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
        if view.spins or not view.has(self.needs):
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

    def __init__(self, side: str, angle: int, velocity: int, settings: VelocityConsistency, period_s: float) -> None:
        """Compare the angle and the velocity of the wheel on one side, which are at these places."""
        self.needs: tuple[int, ...] = (angle, velocity)
        self._side, self._angle, self._velocity = side, angle, velocity
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
        return f"{self._side}.velocity is off by {-off:.2f} rad/s from how {self._side}.angle changes"


class FollowingError(Check):
    """The velocities that the wheels give the robot, too far from those that were asked for too long; see `Check`.

    CiA 402 calls it following error, and watches it with a window and a time-out. A robot takes a while to get from one
    set-point to another, and may go anywhere between them meanwhile: a velocity is right while it lies between the
    smallest and the largest that were asked within the time that the robot takes to settle, give or take the window.
    """

    def __init__(self, left: int, right: int, settings: FollowingErrorSettings, period_s: float) -> None:
        """Watch the wheels whose velocities, rad/s, are at these places."""
        self.needs: tuple[int, ...] = (left, right)
        self._ahead = 0.5 * settings.wheel_radius
        self._turning = settings.wheel_radius / settings.track
        self._left, self._right = left, right
        self._allowed = periods_in(settings.for_s, period_s)
        span, may_rest = periods_in(settings.settle_s, period_s), settings.may_rest
        linear, angular = settings.linear_window, settings.angular_window
        self._linear = None if linear is None else _Way("ahead", "m/s", linear, span, may_rest=may_rest)
        self._angular = None if angular is None else _Way("turning", "rad/s", angular, span, may_rest=may_rest)
        self._now = 0
        self._held = 0
        self._is_following = False

    def look(self, view: View) -> str | None:
        """See `Check`."""
        setpoint = view.setpoint
        if setpoint is None:
            self._is_following = False
        if setpoint is None or view.spins or not view.has(self.needs):
            self._held = 0
            return None
        left, right = view.values[self._left], view.values[self._right]
        linear, angular = setpoint
        self._now += view.periods
        begins, self._is_following = not self._is_following, True
        wrong = None
        if self._linear is not None:
            wrong = self._linear.look(linear, self._ahead * (left + right), self._now, begins=begins)
        if self._angular is not None:
            turns = self._angular.look(angular, self._turning * (right - left), self._now, begins=begins)
            wrong = turns if wrong is None else wrong
        self._held = 0 if wrong is None else self._held + view.periods
        return wrong if self._held >= self._allowed else None


class Runaway(Check):
    """How far the robot drives on, faster than it is asked to and than rest; see `Check`.

    A robot that balances is pushed, and goes where it must to come back: that takes it a short way. One whose sensors
    or motors have it drive off does not come back.
    """

    def __init__(self, left: int, right: int, settings: RunawaySettings, period_s: float) -> None:
        """Watch the wheels whose velocities, rad/s, are at these places."""
        self.needs: tuple[int, ...] = (left, right)
        self._ahead = 0.5 * settings.wheel_radius
        self._left, self._right = left, right
        self._window, self._distance = settings.linear_window, settings.distance_m
        self._period_s = period_s
        self._asked = _Range(periods_in(settings.settle_s, period_s))
        self._now = 0
        self._way = 0.0

    def look(self, view: View) -> str | None:
        """See `Check`."""
        setpoint = view.setpoint
        self._now += view.periods
        if setpoint is None:
            self._asked.clear()
        if setpoint is None or not view.has(self.needs):
            self._way = 0.0
            return None
        velocity = self._ahead * (view.values[self._left] + view.values[self._right])
        low, high = self._asked.add(setpoint[0], self._now)
        low, high = min(low, 0.0), max(high, 0.0)
        over, under = velocity - high - self._window, velocity - low + self._window
        beyond = over if over > 0.0 else min(under, 0.0)
        step = beyond * view.periods * self._period_s
        self._way = self._way + step if self._way * step > 0.0 else step
        if abs(self._way) <= self._distance:
            return None
        return (
            f"the robot runs away: it goes {velocity:.2f} m/s ahead, asked is {low:.2f} to {high:.2f} m/s, and it came "
            f"{abs(self._way):.2f} m further than that"
        )


class _Way:
    """One of the two velocities, against what was asked of it lately."""

    def __init__(self, name: str, unit: str, window: float, span: int, *, may_rest: bool) -> None:
        """Allow it to be off by `window`, in `unit`, from what was asked within `span` periods."""
        self._name = name
        self._unit = unit
        self._window = window
        self._may_rest = may_rest
        self._asked = _Range(span)

    def look(self, asked: float, velocity: float, now: int, *, begins: bool) -> str | None:
        """Keep what is asked in period `now`, and report a velocity that is wrong.

        A robot that `begins` to follow may still move as it does.
        """
        if begins:
            self._asked.clear()
            self._asked.add(velocity, now)
        low, high = self._asked.add(asked, now)
        if self._may_rest:
            low, high = min(low, 0.0), max(high, 0.0)
        if low - self._window <= velocity <= high + self._window:
            return None
        return f"the robot goes {velocity:.2f} {self._unit} {self._name}, asked is {low:.2f} to {high:.2f} {self._unit}"


class _Range:
    """The smallest and the largest of the values that there were lately."""

    def __init__(self, span: int) -> None:
        """Remember values for so many periods after they were last added."""
        self._largest = _Largest(span)
        self._largest_negated = _Largest(span)

    def clear(self) -> None:
        """Discard everything."""
        self._largest.clear()
        self._largest_negated.clear()

    def add(self, value: float, now: int) -> tuple[float, float]:
        """Add a value, which is finite, in period `now`; the smallest and the largest now."""
        return -self._largest_negated.add(-value, now), self._largest.add(value, now)


class _Largest:
    """The largest of the values that there were lately.

    It keeps only what can still become the largest: adding a value costs little, however long the span is.
    """

    def __init__(self, span: int) -> None:
        """Remember values for so many periods after they were last added."""
        self._span = span
        self._kept: deque[tuple[int, float]] = deque()

    def clear(self) -> None:
        """Discard everything."""
        self._kept.clear()

    def add(self, value: float, now: int) -> float:
        """Add a value, which is finite, in period `now`; the largest now."""
        kept = self._kept
        while kept and kept[-1][1] <= value:
            kept.pop()
        kept.append((now, value))
        while kept[0][0] < now - self._span:
            kept.popleft()
        return kept[0][1]
