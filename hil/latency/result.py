# SPDX-License-Identifier: MIT
"""What came of the set-points that were published."""

import enum
import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import Final, NamedTuple, Self

import msgspec

ALLOWED_S: Final = 1e-3
"""What a set-point may take beyond one period of the loop, s."""
_NS_PER_S: Final = 1e9


@enum.unique
class Where(enum.StrEnum):
    """Where the set-points are published."""

    SAME_PROCESS = "same process"
    OTHER_PROCESS = "other process"
    OTHER_HOST = "other host"


class Timed(NamedTuple):
    """The number of a set-point, and when it was published or seen, ns, monotonic."""

    number: int
    at_ns: int


class Latency(msgspec.Struct, frozen=True, kw_only=True):
    """From the moment before a set-point is published to the first motor frame on the bus that is made from it.

    Attributes:
        where: Where they were published; see `Where`.
        actuate: When commands leave; see `segway_ecc.node.config.RobotFile`.
        period_s: Of the loop, s.
        trials: Set-points published, at any phase of the loop.
        missed: Of how many no frame was seen.
        p50_s: Median, s.
        p99_s: The time within which 99 of 100 were there, s.
        max_s: The longest, s.
    """

    where: str
    actuate: str
    period_s: float
    trials: int
    missed: int
    p50_s: float
    p99_s: float
    max_s: float

    @property
    def p99_periods(self) -> float:
        """99 of 100 in periods of the loop."""
        return self.p99_s / self.period_s

    @property
    def limit_s(self) -> float:
        """What is required where robot and publisher are on one host, s."""
        return self.period_s + ALLOWED_S

    @property
    def is_within(self) -> bool:
        """Whether that was kept, and no set-point missed."""
        return self.p99_s <= self.limit_s and self.missed == 0

    def text(self) -> str:
        """One line."""
        values = (("p50", self.p50_s), ("p99", self.p99_s), ("max", self.max_s))
        ms = ", ".join(f"{name} {value * 1e3:.2f} ms" for name, value in values)
        return (
            f"{self.where}, actuate {self.actuate}: {ms} ({self.p99_periods:.2f} periods at p99) of {self.trials} "
            f"set-points, {self.missed} missed"
        )

    @classmethod
    def of(cls, where: Where, actuate: str, period_s: float, published: Sequence[Timed], seen: Sequence[Timed]) -> Self:
        """From what was published and seen; each number is published once, and `seen` is in order of time.

        Raises:
            ValueError: No set-point was seen at all.
        """
        took = sorted(took_s(published, seen))
        if not took:
            raise ValueError("no set-point came through")
        return cls(
            where=str(where),
            actuate=actuate,
            period_s=period_s,
            trials=len(published),
            missed=len(published) - len(took),
            p50_s=quantile(took, 0.5),
            p99_s=quantile(took, 0.99),
            max_s=took[-1],
        )


def took_s(published: Sequence[Timed], seen: Sequence[Timed]) -> list[float]:
    """For each set-point that was seen: how long after its publication the first frame with it was there, s."""
    times: dict[int, list[int]] = {}
    for frame in seen:
        times.setdefault(frame.number, []).append(frame.at_ns)
    found = []
    for number, at_ns in published:
        later = times.get(number, [])
        place = bisect_left(later, at_ns)
        if place < len(later):
            found.append((later[place] - at_ns) / _NS_PER_S)
    return found


def quantile(ordered: Sequence[float], share: float) -> float:
    """The smallest value that this share of all does not exceed."""
    return ordered[max(math.ceil(share * len(ordered)) - 1, 0)]
