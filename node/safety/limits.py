"""The last look at a command before it leaves."""

import math
from collections.abc import Sequence


def not_finite(values: Sequence[float]) -> int | None:
    """The index of the first value that is not finite, if any."""
    for index, value in enumerate(values):
        if not math.isfinite(value):
            return index
    return None


def limit(commands: Sequence[float], limits: Sequence[float]) -> tuple[float, ...]:
    """Clamp each finite command to plus or minus its limit, in the command's unit."""
    return tuple(min(max(value, -bound), bound) for value, bound in zip(commands, limits, strict=True))
