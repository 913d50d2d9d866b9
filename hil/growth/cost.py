# SPDX-License-Identifier: MIT
"""What the cycles cost at one size, and the clock that measures it."""

import enum
import statistics
import time
from collections.abc import Sequence
from typing import Final

import msgspec

from segway_ecc.node.cycle.clock import Clock

SEGMENTS: Final = 5
"""Parts of a run that are looked at on their own: how far apart they are is the spread of what is measured."""


@enum.unique
class Axis(enum.StrEnum):
    """What grows."""

    PORTS = "model ports"
    DRIVES = "drives"
    SUBSCRIBERS = "subscribers"
    ROBOTS = "robots"


class Cost(msgspec.Struct, frozen=True, kw_only=True):
    """CPU time of the loop's thread from the end of one wait to the beginning of the next: the cycle and its slack.

    Attributes:
        p50_us: Median, us.
        p99_us: What 99 of 100 cycles cost at most, us.
        spread_us: Between the largest and the smallest median of the parts of the run, us.
        notes: What else was seen, by name.
    """

    p50_us: float
    p99_us: float
    spread_us: float
    notes: dict[str, str] = {}


class Point(msgspec.Struct, frozen=True, kw_only=True):
    """A size that was tried.

    Attributes:
        axis: What grows.
        size: How many.
        cost: What a cycle costs; None where it does not run.
        refused: Why it does not run; empty where it does.
    """

    axis: Axis
    size: int
    cost: Cost | None
    refused: str = ""


def cost_of(taken_ns: Sequence[int], notes: dict[str, str] | None = None) -> Cost:
    """The cost of cycles, from the CPU time of each, ns; in the order in which they ran.

    Raises:
        ValueError: There are fewer than `SEGMENTS`.
    """
    size = len(taken_ns) // SEGMENTS
    if size == 0:
        raise ValueError(f"{len(taken_ns)} cycles are too few")
    medians = [statistics.median(taken_ns[size * i : size * (i + 1)]) for i in range(SEGMENTS)]
    ordered = sorted(taken_ns)
    return Cost(
        p50_us=statistics.median(ordered) * 1e-3,
        p99_us=ordered[len(ordered) * 99 // 100] * 1e-3,
        spread_us=(max(medians) - min(medians)) * 1e-3,
        notes=notes or {},
    )


def together(costs: Sequence[Cost]) -> Cost:
    """Of several runs, or robots side by side: the medians' median, the worst p99, the spread among and within them."""
    medians = [cost.p50_us for cost in costs]
    return Cost(
        p50_us=statistics.median(medians),
        p99_us=max(cost.p99_us for cost in costs),
        spread_us=max(max(medians) - min(medians), *(cost.spread_us for cost in costs)),
        notes=costs[-1].notes,
    )


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
