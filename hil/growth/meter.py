"""A clock that measures what the loop costs its thread between two waits."""

import time

from segway_ecc.node.cycle.clock import Clock


class MeteredClock:
    """Stands in front of a clock; see `Clock`.

    Attributes:
        taken_ns: CPU time of the thread that waits, from the end of each wait to the beginning of the next, ns.
    """

    def __init__(self, clock: Clock) -> None:
        """Stand in front of `clock`."""
        self.taken_ns: list[int] = []
        self.now_ns = clock.now_ns  # handed on as they are: what is measured must not cost more for it
        self.wall_ns = clock.wall_ns
        self._sleep_until_ns = clock.sleep_until_ns
        self._since_ns: int | None = None

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Wait, and measure what was done before."""
        if self._since_ns is not None:
            self.taken_ns.append(time.thread_time_ns() - self._since_ns)
        self._sleep_until_ns(deadline_ns)
        self._since_ns = time.thread_time_ns()
