"""A robot that does not go as it was told."""

from collections import deque
from collections.abc import Sequence
from typing import Final

from node.safety.check import View, periods_in
from node.safety.settings import FollowingErrorSettings

_UNITS: Final = (("ahead", "m/s"), ("turning", "rad/s"))


class FollowingError:
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
        self._windows = (settings.linear_window, settings.angular_window)
        self._may_rest = settings.may_rest
        self._allowed = periods_in(settings.for_s, period_s)
        span = periods_in(settings.settle_s, period_s)
        self._asked = (_Range(span), _Range(span))
        self._now = 0
        self._held = 0
        self._is_following = False

    def look(self, view: View) -> str | None:
        """See `Check`."""
        if view.setpoint is None:
            self._is_following = False
        if view.setpoint is None or not view.has(self.needs):
            self._held = 0
            return None
        left, right = view.pick(self.needs)
        velocities = (self._ahead * (left + right), self._turning * (right - left))
        self._note(view.setpoint, velocities, view.periods)
        wrong = self._wrong(velocities)
        self._held = 0 if wrong is None else self._held + view.periods
        return wrong if self._held >= self._allowed else None

    def _note(self, setpoint: Sequence[float], velocities: Sequence[float], periods: int) -> None:
        """Keep what is asked; a robot that begins to follow may still move as it does."""
        self._now += periods
        for asked, value, velocity in zip(self._asked, setpoint, velocities, strict=True):
            if not self._is_following:
                asked.clear()
                asked.add(velocity, self._now)
            asked.add(value, self._now)
        self._is_following = True

    def _wrong(self, velocities: Sequence[float]) -> str | None:
        for velocity, window, asked, (way, unit) in zip(velocities, self._windows, self._asked, _UNITS, strict=True):
            if window is None:
                continue
            low, high = asked.low, asked.high
            if self._may_rest:
                low, high = min(low, 0.0), max(high, 0.0)
            if not low - window <= velocity <= high + window:
                return f"the robot goes {velocity:.2f} {unit} {way}, asked is {low:.2f} to {high:.2f} {unit}"
        return None


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
        """Forget everything."""
        self._lows.clear()
        self._highs.clear()

    def add(self, value: float, now: int) -> None:
        """Add a value, which is finite, in period `now`."""
        lows, highs = self._lows, self._highs
        while lows and lows[-1][1] >= value:
            lows.pop()
        while highs and highs[-1][1] <= value:
            highs.pop()
        lows.append((now, value))
        highs.append((now, value))
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
