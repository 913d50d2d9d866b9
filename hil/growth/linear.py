# SPDX-License-Identifier: MIT
"""Where a cost stops being linear in the size."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import msgspec

_FEWEST: Final = 3


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
    """Least squares."""
    count = len(points)
    mean_size = sum(p.size for p in points) / count
    mean_cost = sum(p.cost for p in points) / count
    across = sum((p.size - mean_size) ** 2 for p in points)
    per_one = sum((p.size - mean_size) * (p.cost - mean_cost) for p in points) / across
    bare = LinearFit(at_zero=mean_cost - per_one * mean_size, per_one=per_one, spread=0.0, up_to=points[-1].size)
    spread = max(max(abs(p.cost - bare(p.size)), p.spread) for p in points)
    return msgspec.structs.replace(bare, spread=spread)
