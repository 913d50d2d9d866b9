# SPDX-License-Identifier: MIT
"""The wall-clock stamp of each cycle.

Set-points are stamped ahead and durations counted in model time, so while any is scheduled the stamps of consecutive
cycles differ by exactly one period, even where deadlines were missed. Only while no manoeuvre is being played does
the time base follow the wall clock again.
"""


class TimeBase:
    """The line through the stamps of the cycles: `stamp_ns(k) = anchor_ns + k * period_ns`.

    Attributes:
        realigned: How often the line was moved to follow the wall clock.
    """

    def __init__(self, period_ns: int) -> None:
        """Prepare the line; `anchor` places it."""
        self.period_ns = period_ns
        self.realigned = 0
        self._anchor_ns = 0

    def anchor(self, cycle: int, stamp_ns: int) -> None:
        """Place the line so that a cycle has this stamp."""
        self._anchor_ns = stamp_ns - cycle * self.period_ns

    def stamp_ns(self, cycle: int) -> int:
        """The stamp of a cycle, ns since the Unix epoch."""
        return self._anchor_ns + cycle * self.period_ns

    def cycle_of(self, stamp_ns: int) -> int:
        """The cycle whose stamp is nearest."""
        return (stamp_ns - self._anchor_ns + self.period_ns // 2) // self.period_ns

    def follow(self, cycle: int, deadline_wall_ns: int) -> None:
        """Move the line where this cycle's deadline is more than half a period off it.

        To be called only while no manoeuvre is being played.
        """
        off_ns = deadline_wall_ns - self.stamp_ns(cycle)
        if 2 * abs(off_ns) > self.period_ns:
            self._anchor_ns += off_ns
            self.realigned += 1
