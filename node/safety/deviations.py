# SPDX-License-Identifier: MIT
"""By how much a robot differs from its design, and whose doing that is said to be."""

from collections.abc import Sequence
from typing import Final

CAUSES: Final = ("payload", "slope", "friction", "radius")
UNITS: Final = ("kg", "rad", "N m", "1")
_SLOPE: Final = 1
_FRICTION: Final = 2
_RADIUS: Final = 3
_ENDS_BELOW: Final = 0.5
"""As a share of its limit: what lies between the two neither begins nor ends a warning."""


class Deviations:
    """Warns of a cause whose estimate is beyond its limit for a while, where it can be no other.

    Attributes:
        warned: For each of `CAUSES` whether it is beyond its limit, as last reported.
    """

    def __init__(self, limits: Sequence[float], lasts: int) -> None:
        """Warn of each cause beyond its limit, in its unit, after so many judgements, at least 1."""
        self._limits, self._lasts = tuple(limits), lasts
        self._beyond = [0] * len(CAUSES)
        self.warned = [False] * len(CAUSES)

    def judge(self, estimates: Sequence[float], *, is_radius_known: bool) -> str | None:
        """Take an estimate of each cause; gives the warnings that begin or end with it.

        `is_radius_known` is whether that of the radius rests on enough.
        """
        said = []
        for cause, limit in enumerate(self._limits):
            size, beyond = abs(estimates[cause]), self._beyond[cause]
            if size > limit and self._is_alone(cause, estimates, is_radius_known=is_radius_known):
                self._beyond[cause] = min(beyond + 1, self._lasts)
            elif size < _ENDS_BELOW * limit:
                self._beyond[cause] = max(beyond - 1, 0)
            if self._beyond[cause] == (0 if self.warned[cause] else self._lasts):
                self.warned[cause] = not self.warned[cause]
                said.append(self._text(cause, estimates[cause]))
        return "; ".join(said) or None

    def _is_alone(self, cause: int, estimates: Sequence[float], *, is_radius_known: bool) -> bool:
        """Whether nothing else is there that looks like this: a slope does like friction, and a tyre like a payload."""
        if cause in {_SLOPE, _RADIUS}:
            return True
        is_level = abs(estimates[_SLOPE]) <= _ENDS_BELOW * self._limits[_SLOPE]
        is_round = is_radius_known and abs(estimates[_RADIUS]) < _ENDS_BELOW * self._limits[_RADIUS]
        return is_level and (cause == _FRICTION or is_round)

    def _text(self, cause: int, estimate: float) -> str:
        """A warning that begins or ends."""
        value = f"{CAUSES[cause]} {estimate:+.3g} {UNITS[cause]}"
        if not self.warned[cause]:
            return f"the robot moves as designed again: {value}"
        return f"the robot does not move as designed: {value}, beyond {self._limits[cause]:g} {UNITS[cause]}"
