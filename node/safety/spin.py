# SPDX-License-Identifier: MIT
"""Wheels that lose the floor: for a moment at an edge, or because the robot is lifted."""

from typing import Final

from segway_ecc.node.safety.check import periods_in

_FREE: Final = 45.0
"""All the torque that its drives give speeds up the published robot by 43 m/s2: a wheel that gains more, m/s2, has no
floor."""
_UNFELT: Final = 12.0
_UNFELT_S: Final = 0.015
"""Both wheels that gain more, m/s2, for so long, s, may have none either, if the IMU does not feel it, or is late."""
_FELT_SHARE: Final = 0.5
"""It feels less than this part of what the wheels gain."""
_LIKELY_S: Final = 0.5
_IDLE_S: Final = 0.02
"""A controller that sends nothing for so long, s, not later than that afterwards, took the robot for lifted too."""
_WITHIN_S: Final = 1.0
"""Spins that are further apart do not add up, s; and for so long the robot must have been up, since before it slips."""
_MOST_S: Final = 0.5
_MOST_SPINS: Final = 2.0
"""Longer in sum than the greater of that, s, and so many of the longest spin is a fault."""
_FASTEST: Final = 10.0
"""No wheel gets that fast, m/s, while it is without the floor: what is said to be faster is no wheel, and counts."""
_LIFTED_S: Final = 0.03
"""So long at a time both wheels must spin alike while something carries the body, s, until it counts as lifted: a robot
that climbs an edge has a wheel on the floor, and one that leaps falls freely."""
_ALIKE: Final = 0.8
"""Wheels spin alike that differ by less than this part of the faster one's: at an edge they bounce in turns."""
_HARDLY: Final = 20.0
"""Which of two wheels that both gain less, m/s2, does so faster means nothing."""
_RESTS: Final = 0.1
"""Wheels of a lifted robot that are slower, m/s, are as good as braked."""
_TURN_S: Final = 0.1
_MOST_TURN: Final = 1.0
"""What a turn adds to one wheel and takes from the other is learnt in that time, s, where it is less than that, m/s: a
wheel that fails is no turn."""


class SpinWatch:
    """Which of both wheels shows how the robot moves, while one spins.

    A wheel that loses the floor spins up, faster than one that carries the robot can. Until it is back, and for
    `longest_s` at most, the one of both wheels counts that agrees with the IMU, none where neither does. The wheels
    alone begin that: an IMU that fails does not. The robot is taken to turn on meanwhile as it did: by so much the
    wheels differ.

    Both that spin alike, while the accelerometer feels that something carries the body, carry it no more: the robot is
    lifted. It is given the rest of the time to brake them. Both that gain less than shows a spin, but what the IMU does
    not feel, are those of a lifted robot if its controller has given up since.

    Attributes:
        is_on: Whether a wheel spins, or did a moment ago.
        fault: What is wrong, once a spin is over: the robot is lifted, or spins add up to too much.
    """

    def __init__(self, longest_s: float, near: float, period_s: float) -> None:
        """Let a wheel spin for so long, s; it is back where it is as `near` to the IMU's velocity, m/s."""
        self._near = near
        self._most_gain = _FREE * period_s
        self._longest = periods_in(longest_s, period_s)
        self._within = periods_in(_WITHIN_S, period_s)
        self._most_s = max(_MOST_S, _MOST_SPINS * longest_s)
        self._most = periods_in(self._most_s, period_s)
        self._most_alike = periods_in(_LIFTED_S, period_s)
        self._hardly = _HARDLY * period_s
        self._likely_for, self._most_idle = periods_in(_LIKELY_S, period_s), periods_in(_IDLE_S, period_s)
        self._least_unfelt, self._most_unfelt = _UNFELT * period_s, periods_in(_UNFELT_S, period_s)
        self._turn_part = period_s / _TURN_S
        self.is_on = self._is_lifted = False
        self.fault: str | None = None
        self._left = self._right = self._shown = self._turn = 0.0
        self._up = self._since = self._spent = self._lasts = self._alike = self._unfelt = self._likely = self._idle = 0
        self._over = self._within

    def begin(self) -> None:
        """Begin anew: all else that counts is learnt again before the robot has been up for long enough to spin."""
        self.is_on = False
        self._up, self._over = 0, self._within

    @property
    def was_on(self) -> bool:
        """Whether a wheel spins, or did within the last second."""
        return self.is_on or self._over < self._within

    def look(  # noqa: PLR0913 - what there is of a cycle
        self, left: float, right: float, shown: float, periods: int, *, balances: bool, is_held: bool, is_idle: bool
    ) -> float:
        """The axle's velocity, m/s, by both wheels, or one, or as the IMU has `shown`, so many periods later.

        `is_held` is whether the IMU feels that something carries the body, `is_idle` whether nothing is sent.
        """
        most = self._most_gain * periods
        left_gain, right_gain, felt = left - self._left, right - self._right, shown - self._shown
        gains = abs(left_gain) > most or abs(right_gain) > most
        rest = abs(left) < _RESTS and abs(right) < _RESTS
        self._left, self._right, self._shown, self.fault = left, right, shown, None
        self._since += periods
        self._over = 0 if self.is_on else self._over + periods
        self._up = self._up + periods if balances else 0
        self._idle = self._idle + periods if is_idle else 0
        self._look_for_unfelt(left_gain, right_gain, felt, periods)
        is_up, is_credible = self._up >= self._within, abs(left) < _FASTEST and abs(right) < _FASTEST
        if is_up and rest and self._likely and self._idle >= self._most_idle:
            self._is_lifted = self.is_on = True
            self._end()
        elif not (is_up and is_credible and (gains or self.is_on)):  # nearly always
            self.is_on = self._is_lifted = False
            self._learn_turn(0.5 * (right - left), periods)
        else:
            spins_alike = is_held and self._gain_alike(left_gain, right_gain, periods)
            return self._by_what_rolls(
                left + self._turn, right - self._turn, shown, periods, rest=rest, may_be_lifted=spins_alike
            )
        return 0.5 * (left + right)

    def _by_what_rolls(  # noqa: PLR0913 - what there is of a spin
        self, left: float, right: float, shown: float, periods: int, *, rest: bool, may_be_lifted: bool
    ) -> float:
        """The axle's velocity, m/s, during a spin, by wheels as fast as they were if the robot did not turn."""
        left_off, right_off = left - shown, right - shown
        left_rolls, right_rolls = abs(left_off) < self._near, abs(right_off) < self._near
        if left_rolls and right_rolls and not self._is_lifted:
            self._end()
            return 0.5 * (left + right)
        if not self.is_on:
            self.is_on, self._lasts, self._alike = True, 0, 0
            if self._since >= self._within:
                self._spent = 0
        self._lasts += periods
        self._spent += periods
        both_spin = not (left_rolls or right_rolls) and left * left_off > 0.0 and right * right_off > 0.0
        if both_spin and may_be_lifted and _are_alike(left_off, right_off):
            self._alike += periods
            self._is_lifted = self._is_lifted or self._alike >= self._most_alike
        else:
            self._alike = 0
        if self._lasts >= self._longest or (self._is_lifted and rest):
            self._end()
            return 0.5 * (left + right)
        if left_rolls:
            return left
        return right if right_rolls else shown

    def _learn_turn(self, turn: float, periods: int) -> None:
        """Learn what a turn adds to the right wheel, m/s."""
        if abs(turn) < _MOST_TURN:
            self._turn += self._turn_part * periods * (turn - self._turn)

    def _look_for_unfelt(self, left: float, right: float, felt: float, periods: int) -> None:
        """Note that both wheels have gained speed for long, m/s now, which the IMU does not feel to be the robot's."""
        self._likely = max(self._likely - periods, 0)
        least = min(abs(left), abs(right))
        if least < self._least_unfelt * periods or left * right < 0.0 or abs(felt) > _FELT_SHARE * least:  # mostly
            self._unfelt = 0
            return
        self._unfelt += periods
        if self._unfelt >= self._most_unfelt:
            self._likely = self._likely_for

    def _gain_alike(self, left: float, right: float, periods: int) -> bool:
        """Whether both wheels gain speed alike, m/s, or hardly any."""
        return max(abs(left), abs(right)) < self._hardly * periods or _are_alike(left, right)

    def _end(self) -> None:
        """Add up a spin that is over, if there was one."""
        if not self.is_on:
            return
        self.is_on, self._since = False, 0
        if self._is_lifted:
            self._is_lifted, self._likely = False, 0
            self.fault = "both wheels have lost the floor: the robot is lifted"
        elif self._spent > self._most:
            self.fault = f"wheels have no floor for more than {self._most_s:g} s in all"


def _are_alike(left: float, right: float) -> bool:
    """Whether these are of two wheels that are given alike and that nothing holds, m/s."""
    return abs(left - right) < _ALIKE * max(abs(left), abs(right))
