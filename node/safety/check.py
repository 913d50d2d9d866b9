"""What every check of the sensors is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol


class View(NamedTuple):
    """What a check sees in one cycle.

    Attributes:
        values: Newest value of each signal, SI, in the order of the robot's signals.
        valid: Whether each is fresh enough to be used.
        periods: How many periods have passed since the last cycle: 1, and more where deadlines were skipped.
    """

    values: Sequence[float]
    valid: Sequence[bool]
    periods: int

    def has(self, indices: Sequence[int]) -> bool:
        """Whether all of these signals may be used."""
        return all(self.valid[index] for index in indices)

    def pick(self, indices: Sequence[int]) -> tuple[float, ...]:
        """The values of these signals."""
        return tuple(self.values[index] for index in indices)


class Check(Protocol):
    """Looks at every cycle.

    Attributes:
        needs: The signals without whose values it cannot see.
    """

    needs: tuple[int, ...]

    def look(self, view: View) -> str | None:
        """What is wrong, if anything; values that are not valid are not looked at."""


@dataclass(frozen=True, slots=True)
class Signal:
    """A signal and its place in the robot's signals."""

    name: str
    index: int


def periods_in(duration_s: float, period_s: float) -> int:
    """How many periods a duration is, at least one."""
    return max(round(duration_s / period_s), 1)
