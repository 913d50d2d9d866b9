# SPDX-License-Identifier: MIT
"""Time, injected: the same code runs on the robot's clock and on a simulated one."""

import time
from typing import Final, Protocol

NS_PER_S: Final = 1_000_000_000


class Clock(Protocol):
    """A monotonic clock to wait on, and the wall clock for stamps; integers, so that no sum of periods drifts."""

    def now_ns(self) -> int:
        """Monotonic time, ns."""

    def wall_ns(self) -> int:
        """Time since the Unix epoch, ns; may jump."""

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Wait until the monotonic clock reads `deadline_ns`; return at once if it has passed."""


def wall_ns() -> int:
    """CLOCK_REALTIME, ns: what SocketCAN stamps received frames with."""
    return time.clock_gettime_ns(time.CLOCK_REALTIME)


class RealClock:
    """The machine's clock."""

    # CLOCK_MONOTONIC; asked for some thirty times in a cycle, so without a function in Python.
    now_ns = staticmethod(time.monotonic_ns)
    wall_ns = staticmethod(wall_ns)

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Sleep; the standard library itself waits for an absolute deadline."""
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns / NS_PER_S)
