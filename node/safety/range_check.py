# SPDX-License-Identifier: MIT
"""Single values beyond what they may be."""

from segway_ecc.node.safety.check import Check, Signal, View


class RangeCheck(Check):
    """A value that must lie in a window; what is not a number lies in none. See `Check`."""

    def __init__(self, signal: Signal, low: float, high: float, unit: str) -> None:
        """Let a signal be from `low` to `high`, both in its unit."""
        self.needs: tuple[int, ...] = (signal.index,)
        self._name = signal.name
        self._index = signal.index
        self._low = low
        self._high = high
        self._unit = unit

    def look(self, view: View) -> str | None:
        """See `Check`."""
        value = view.values[self._index]
        if not view.has(self.needs) or self._low <= value <= self._high:
            return None
        window = f"{self._low:g} to {self._high:g} {self._unit}"
        return f"{self._name} is {value:.2f} {self._unit}, allowed is {window}"
