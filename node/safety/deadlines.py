# SPDX-License-Identifier: MIT
"""When the deadlines that were missed are too many to control a robot with, and the rate that the loop achieves."""

from collections import deque
from typing import Final

from segway_ecc.node.safety.check import periods_in
from segway_ecc.node.safety.settings import LateCyclesLimit

LATE_FRACTION: Final = 0.5
"""A cycle that starts later than this fraction of a period has missed its deadline."""
WINDOW_S: Final = 1.0
"""The rate is measured over this long, s."""
_NS_PER_S: Final = 1_000_000_000


class DeadlineWatch:
    """Counts missed deadlines, in a row and in a window."""

    def __init__(self, limit: LateCyclesLimit, period_ns: int) -> None:
        """Watch deadlines that are a period apart, ns."""
        self._in_a_row = limit.in_a_row
        self._late_ns = LATE_FRACTION * period_ns
        self._window = periods_in(limit.window_s, period_ns * 1e-9)
        self._missed: deque[int] = deque(maxlen=limit.in_window or 0)
        self._row = 0
        self._deadline = 0

    def look(self, periods: int, lateness_ns: int) -> str | None:
        """Take a cycle that comes `periods` after the last one, and started this late; what is wrong, if anything."""
        self._deadline += periods
        is_late = lateness_ns > self._late_ns
        if periods > 1:
            skipped = range(self._deadline - periods + 1, self._deadline)
            self._missed.extend(skipped[-(self._missed.maxlen or 1) :])
            self._row += len(skipped)
        if is_late:
            self._missed.append(self._deadline)
            self._row += 1
        row = self._row
        if not is_late:
            self._row = 0
        if row >= self._in_a_row:
            return f"{row} deadlines in a row were missed, fewer than {self._in_a_row} are allowed"
        missed = self._missed
        if not missed.maxlen or len(missed) < missed.maxlen or self._deadline - missed[0] >= self._window:
            return None
        return (
            f"{len(missed)} of the last {self._window} deadlines were missed, fewer than {missed.maxlen} are allowed: "
            "a step takes longer than its period, or the machine is too busy"
        )


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
