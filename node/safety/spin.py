# SPDX-License-Identifier: MIT
"""Wheels that lose the floor: for a moment at an edge, or because the robot is lifted."""

from typing import Final

from segway_ecc.node.safety.check import periods_in

_FREE: Final = 45.0
"""All the torque that its drives give speeds up the published robot by 43 m/s2: a wheel that gains more, m/s2, has no
floor."""
_WITHIN_S: Final = 1.0
"""Spins that are further apart do not add up, s; and for so long the robot must have been up, since before it slips."""
_MOST_S: Final = 0.5
"""Longer than that in sum is a fault, s."""
_FASTEST: Final = 10.0
"""No wheel gets that fast, m/s, while it is without the floor: what is said to be faster is no wheel, and counts."""
_BOTH_S: Final = 0.02
"""So long both wheels may be off the same way, s: a robot that climbs an edge has one wheel on the floor."""
_TURN_S: Final = 0.1
_MOST_TURN: Final = 1.0
"""What a turn adds to one wheel and takes from the other is learnt in that time, s, where it is less than that, m/s: a
wheel that fails is no turn."""
_LEAD: Final = 3.0
"""So many periods after it was sent a torque acts: what brakes the wheels of a lifted robot must end as much sooner."""


class SpinWatch:
    """Which of both wheels shows how the robot moves, while one spins.

    A wheel that loses the floor spins up, faster than one that carries the robot can. Until it is back, and for
    `longest_s` at most, the one of both wheels counts that agrees with the IMU, none where neither does. The wheels
    alone begin that: an IMU that fails does not. The robot is taken to turn on meanwhile as it did: by so much the
    wheels differ.

    Attributes:
        is_on: Whether a wheel spins, or did a moment ago.
        fault: What is wrong, once a spin is over: both wheels were off, and are brought to rest or back, or spins add
            up to too much.
    """

    def __init__(self, longest_s: float, near: float, period_s: float) -> None:
        """Let a wheel spin for so long, s; it is back where it is as `near` to the IMU's velocity, m/s."""
        self._near = near
        self._most_gain = _FREE * period_s
        self._longest = periods_in(longest_s, period_s)
        self._within = periods_in(_WITHIN_S, period_s)
        self._most = periods_in(_MOST_S, period_s)
        self._most_both = periods_in(_BOTH_S, period_s)
        self._turn_part = period_s / _TURN_S
        self.begin(0.0, 0.0)

    def begin(self, left: float, right: float) -> None:
        """Begin anew with both wheels' velocities, m/s."""
        self.is_on = False
        self.fault: str | None = None
        self._left, self._right, self._turn = left, right, 0.0
        self._up = self._since = self._spent = self._lasts = self._both = 0

    def look(self, left: float, right: float, shown: float, periods: int, *, balances: bool) -> float:
        """The axle's velocity, m/s, by both wheels, or one, or as the IMU has `shown`, so many periods later."""
        most = self._most_gain * periods
        gains = abs(left - self._left) > most or abs(right - self._right) > most
        turns, before = left + right, self._left + self._right
        self._left, self._right, self.fault = left, right, None
        self._since += periods
        self._up = self._up + periods if balances else 0
        begins = (gains or self.is_on) and self._up >= self._within  # hardly ever
        if not begins or not (abs(left) < _FASTEST and abs(right) < _FASTEST):
            self.is_on = False
            turn = 0.5 * (right - left)
            if abs(turn) < _MOST_TURN:
                self._turn += self._turn_part * periods * (turn - self._turn)
            return 0.5 * (left + right)
        left, right = left + self._turn, right - self._turn
        left_off, right_off = left - shown, right - shown
        left_rolls, right_rolls = abs(left_off) < self._near, abs(right_off) < self._near
        if left_rolls and right_rolls:
            self._end()
            return 0.5 * (left + right)
        if not self.is_on:
            self.is_on, self._lasts = True, 0
            if self._since >= self._within:
                self._spent = self._both = 0
        self._lasts += periods
        self._spent += periods
        if not (left_rolls or right_rolls or left_off * right_off < 0.0):
            self._both += periods
        is_stopping = self._both >= self._most_both and turns * (turns + _LEAD * (turns - before)) <= 0.0
        if self._lasts >= self._longest or is_stopping:
            self._end()
            return 0.5 * (left + right)
        if left_rolls:
            return left
        return right if right_rolls else shown

    def _end(self) -> None:
        """Add up a spin that is over, if there was one."""
        if not self.is_on:
            return
        self.is_on, self._since = False, 0
        if self._both >= self._most_both:
            self._both = 0
            self.fault = "both wheels have lost the floor: the robot is lifted, or leaps"
        elif self._spent > self._most:
            self.fault = f"wheels have no floor for more than {_MOST_S:g} s in a second"
