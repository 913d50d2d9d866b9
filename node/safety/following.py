# SPDX-License-Identifier: MIT
"""A robot that does not follow its set-points."""

from collections import deque

from segway_ecc.node.safety.check import Check, View, periods_in
from segway_ecc.node.safety.settings import FollowingErrorSettings


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
        if setpoint is None or not view.has(self.needs):
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
        self._asked.add(asked, now)
        low, high = self._asked.low, self._asked.high
        if self._may_rest:
            low, high = min(low, 0.0), max(high, 0.0)
        if low - self._window <= velocity <= high + self._window:
            return None
        return f"the robot goes {velocity:.2f} {self._unit} {self._name}, asked is {low:.2f} to {high:.2f} {self._unit}"


class _Range:
    """The smallest and the largest of the values that there were lately.

    Each deque holds only what can still become an end of the range: adding a value costs little, however long it is.
    """

    def __init__(self, span: int) -> None:
        """Remember values for so many periods after they were last added."""
        self._span = span
        self._lows: deque[tuple[int, float]] = deque()
        self._highs: deque[tuple[int, float]] = deque()

    def clear(self) -> None:
        """Discard everything."""
        self._lows.clear()
        self._highs.clear()

    def add(self, value: float, now: int) -> None:
        """Add a value, which is finite, in period `now`."""
        lows, highs = self._lows, self._highs
        while lows and lows[-1][1] >= value:
            lows.pop()
        while highs and highs[-1][1] <= value:
            highs.pop()
        added = (now, value)
        lows.append(added)
        highs.append(added)
        oldest = now - self._span
        while lows[0][0] < oldest:
            lows.popleft()
        while highs[0][0] < oldest:
            highs.popleft()

    @property
    def low(self) -> float:
        """The smallest."""
        return self._lows[0][1]

    @property
    def high(self) -> float:
        """The largest."""
        return self._highs[0][1]
