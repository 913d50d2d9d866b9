# SPDX-License-Identifier: MIT
"""What the loop is to be, as ratios of figures from one run: a machine that is twice as slow changes none of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from segway_ecc.hil.bench.comparison import ProgramResult
from segway_ecc.hil.bench.contestants import Contestant

COST_OF_USERS: Final = 0.25
COST_OF_LIMIT: Final = 6.0
LATENESS_OF_BARE: Final = 1.5
ENOUGH_CYCLES: Final = 3000
"""For a p99.9 of something: with fewer, two or three cycles decide it."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A ratio, and the most that it may be.

    Attributes:
        what: What is divided by what.
        ratio: What it is in this run.
        limit: What it is to be at most.
    """

    what: str
    ratio: float
    limit: float

    @property
    def is_met(self) -> bool:
        """Whether it is no more."""
        return self.ratio <= self.limit

    def as_text(self) -> str:
        """One line."""
        return f"{self.what}: {self.ratio:.2f}, at most {self.limit:g} wanted: {'met' if self.is_met else 'NOT met'}"


def claims(results: Mapping[Contestant, ProgramResult]) -> list[Claim]:
    """The claims that can be judged by these results."""
    found = []
    ours = results.get(Contestant.OURS)
    if ours is None:
        return []
    if ours.fault is not None:
        return [Claim(f"runs in which our loop gave up ({ours.fault.partition(';')[0]})", 1.0, 0.0)]
    kind = "mean" if ours.cycles.is_coarse else "p50"
    for other, name, limit in (
        (Contestant.USER, "the user's loop", COST_OF_USERS),
        (Contestant.C, "the loop in C", COST_OF_LIMIT),
    ):
        if other in results:
            ratio = ours.cycles.typical_cost_s / results[other].cycles.typical_cost_s
            found.append(Claim(f"CPU time of a cycle, {kind}, ours to {name}", ratio, limit))
    if Contestant.BARE in results and ours.cycles.count >= ENOUGH_CYCLES:
        ratio = ours.cycles.lateness.p999_s / results[Contestant.BARE].cycles.lateness.p999_s
        found.append(Claim("wake-up lateness, p99.9, ours to a bare loop in C", ratio, LATENESS_OF_BARE))
    return found
