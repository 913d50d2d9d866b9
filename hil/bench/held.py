# SPDX-License-Identifier: MIT
"""The highest rate that each program holds: no cycle late, no deadline lost."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from segway_ecc.hil.bench.comparison import ComparisonSetup, compare
from segway_ecc.hil.bench.contestants import Contestant
from segway_ecc.hil.bench.samples import Cycles

RATES_HZ: Final = (100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0, 10000.0)
SEARCHED: Final = (Contestant.OURS, Contestant.USER, Contestant.C)
_HOPELESS: Final = 0.01
"""A program that is late, or loses, in more than this part of its cycles is not tried at a higher rate."""


@dataclass(frozen=True, slots=True)
class SustainedRates:
    """How a program did at the rates that it was tried at.

    Attributes:
        tried: Its cycles at each rate, Hz.
        faults: Why it gave up, at the rates at which it did.
    """

    tried: dict[float, Cycles]
    faults: dict[float, str]

    @property
    def in_time_hz(self) -> float:
        """The highest rate up to which no cycle was late and none was lost; 0 where there is none."""
        return self._up_to(lambda cycles: cycles.is_held)

    @property
    def complete_hz(self) -> float:
        """The highest rate up to which no deadline passed without its cycle; 0 where there is none."""
        return self._up_to(lambda cycles: not cycles.lost)

    def _up_to(self, is_good: Callable[[Cycles], bool]) -> float:
        highest = 0.0
        for rate_hz, cycles in sorted(self.tried.items()):
            if rate_hz in self.faults or not is_good(cycles):
                break
            highest = rate_hz
        return highest


def search(
    setup: ComparisonSetup,
    hold_s: float,
    who: Sequence[Contestant] = SEARCHED,
    rates_hz: Sequence[float] = RATES_HZ,
) -> dict[Contestant, SustainedRates]:
    """Try the rates from the lowest up; a program that fails one by far is not tried at the next.

    Args:
        setup: Where, and under which conditions.
        hold_s: How long each rate is to be held, s.
        who: Which programs.
        rates_hz: The rates.

    Raises:
        ConfigurationError: One of them does not run here.
    """
    found = {one: SustainedRates({}, {}) for one in who}
    left = list(who)
    for rate_hz in sorted(rates_hz):
        for one, result in compare(setup, rate_hz, hold_s, 1, tuple(left)).items():
            found[one].tried[rate_hz] = result.cycles
            if result.fault is not None:
                found[one].faults[rate_hz] = result.fault
            if (
                result.fault is not None
                or max(result.cycles.late, result.cycles.lost) > _HOPELESS * result.cycles.count
            ):
                left.remove(one)
        if not left:
            break
    return found
