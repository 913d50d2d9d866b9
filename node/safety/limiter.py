# SPDX-License-Identifier: MIT
"""The last look at commands before they leave: finite, within their limits, and no faster than their slew rate."""

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


def slew(commands: Sequence[float], previous: Sequence[float], step: float) -> tuple[float, ...]:
    """Bring each finite command to within `step` of what it was, in the command's unit."""
    return tuple([min(max(value, old - step), old + step) for value, old in zip(commands, previous, strict=True)])


class CommandLimiter:
    """Keeps commands within the drive's limits, the robot's own, and its slew rate.

    `limits` is the largest magnitude of each command, in its unit.
    """

    def __init__(
        self, limits: Sequence[float], max_command: float | None, slew_rate: float | None, period_s: float
    ) -> None:
        """Restrain commands that leave once per period, s; `slew_rate` is in their unit per second."""
        self.limits = tuple(limits) if max_command is None else tuple(min(bound, max_command) for bound in limits)
        self._step = None if slew_rate is None else slew_rate * period_s

    def apply(self, commands: Sequence[float], previous: Sequence[float]) -> tuple[float, ...]:
        """What may be sent after `previous`."""
        limited = limit(commands, self.limits)
        return limited if self._step is None else slew(limited, previous, self._step)
