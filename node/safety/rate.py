# SPDX-License-Identifier: MIT
"""The rate that the loop really achieves, and for how long the IMU has been still."""

from collections import deque
from math import hypot
from typing import Final

from segway_ecc.node.safety.tilt import GRAVITY, Vector

_NS_PER_S: Final = 1_000_000_000
WINDOW_S: Final = 1.0
"""The rate is measured over this long, s."""


class RateMeter:
    """Cycles per second over the last second."""

    def __init__(self, period_ns: int) -> None:
        """Measure cycles that should be a period apart, ns."""
        self.wanted_hz = _NS_PER_S / period_ns
        self._starts_ns: deque[int] = deque(maxlen=max(round(WINDOW_S * self.wanted_hz), 1) + 1)

    def mark(self, start_ns: int) -> None:
        """Note when a cycle started, ns, monotonic."""
        self._starts_ns.append(start_ns)

    @property
    def rate_hz(self) -> float | None:
        """Over as many cycles as should make a second; None before there were that many."""
        starts_ns = self._starts_ns
        if len(starts_ns) != starts_ns.maxlen:
            return None
        return (len(starts_ns) - 1) * _NS_PER_S / max(starts_ns[-1] - starts_ns[0], 1)


class StillWatch:
    """For how many periods an IMU has been still."""

    def __init__(self, rate_limit: float, acceleration_limit: float) -> None:
        """Call still what turns no faster, rad/s, and whose acceleration is no further from gravity, m/s2."""
        self.periods = 0
        self._rate_limit = rate_limit
        self._acceleration_limit = acceleration_limit

    def look(self, gyro: Vector, accelerometer: Vector, periods: int) -> None:
        """Take a sample, so many periods after the last."""
        (gx, gy, gz), (ax, ay, az) = gyro, accelerometer
        turns = hypot(gx, gy, gz) > self._rate_limit
        moves = abs(hypot(ax, ay, az) - GRAVITY) > self._acceleration_limit
        self.periods = 0 if turns or moves else self.periods + periods

    def interrupt(self) -> None:
        """Begin anew: no sample was to be had."""
        self.periods = 0
