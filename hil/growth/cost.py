# SPDX-License-Identifier: MIT
"""What the cycles cost at one size, the clock that measures it, and where a cost stops being linear in the size."""

import enum
import statistics
import time
from collections.abc import Sequence
from typing import Final, NamedTuple

import msgspec

from segway_ecc.firmware_io.clock import Clock

SEGMENTS: Final = 5
"""Parts of a run that are looked at on their own: how far apart they are is the spread of what is measured."""
_FEWEST: Final = 3
"""Sizes that a line is laid through."""


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
    """A size that was tried, with what a cycle costs there; or why it is refused, where it does not run."""

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
    """Stands in front of a clock; see `Clock`. It keeps the CPU time of the thread that waits.

    `taken_ns` is that time from the end of each wait to the beginning of the next, ns.
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


class Measured(NamedTuple):
    """A size, what it costs, and how uncertain that is."""

    size: float
    cost: float
    spread: float


class LinearFit(msgspec.Struct, frozen=True, kw_only=True):
    """The line through the small sizes.

    Attributes:
        at_zero: The cost at size zero.
        per_one: What one more costs.
        spread: The largest distance of a size that it was laid through, or the largest spread of one: the larger.
        up_to: The largest size that it holds for.
        left_at: The first size that is off it by more than the spread; None where there is none.
        off: By how much the cost is off there; 0 where there is none.
    """

    at_zero: float
    per_one: float
    spread: float
    up_to: float
    left_at: float | None = None
    off: float = 0.0

    def __call__(self, size: float) -> float:
        """The cost that the line gives for a size."""
        return self.at_zero + self.per_one * size


def line(points: Sequence[Measured]) -> LinearFit:
    """Lay a line through the smallest sizes, and go on with each next one that is on it within the spread.

    Through three, and more where their costs do not differ by more than twice their spread: such a line, laid on to
    sizes many times as large, would be one of chance. A single size that is off while the next is on the line again is
    no end of it, but chance too.

    Raises:
        ValueError: There are fewer than three sizes.
    """
    if len(points) < _FEWEST:
        raise ValueError(f"{len(points)} sizes are too few for a line")
    count = _FEWEST
    while count < len(points) and (
        abs(points[count - 1].cost - points[0].cost) <= 2.0 * max(point.spread for point in points[:count])
    ):
        count += 1
    kept, rest = list(points[:count]), points[count:]
    found = _through(kept)
    for place, point in enumerate(rest):
        if _is_on(found, point):
            kept.append(point)
            found = _through(kept)
        elif not any(_is_on(found, later) for later in rest[place + 1 : place + 2]):
            return msgspec.structs.replace(found, left_at=point.size, off=point.cost - found(point.size))
    return found


def _is_on(found: LinearFit, point: Measured) -> bool:
    return abs(point.cost - found(point.size)) <= max(found.spread, point.spread)


def _through(points: Sequence[Measured]) -> LinearFit:
    per_one, at_zero = statistics.linear_regression([p.size for p in points], [p.cost for p in points])
    bare = LinearFit(at_zero=at_zero, per_one=per_one, spread=0.0, up_to=points[-1].size)
    spread = max(max(abs(p.cost - bare(p.size)), p.spread) for p in points)
    return msgspec.structs.replace(bare, spread=spread)
