"""The last look at a command before it leaves."""

from collections.abc import Sequence
from math import isfinite


def not_finite(values: Sequence[float]) -> int | None:
    """The index of the first value that is not finite, if any."""
    if isfinite(sum(values)):  # in nearly every cycle: a sum is finite only where all of its terms are
        return None
    for index, value in enumerate(values):
        if not isfinite(value):
            return index
    return None


def limit(commands: Sequence[float], limits: Sequence[float]) -> tuple[float, ...]:
    """Clamp each finite command to plus or minus its limit, in the command's unit."""
    return tuple(
        [
            value if -bound <= value <= bound else min(max(value, -bound), bound)
            for value, bound in zip(commands, limits, strict=True)
        ]
    )
