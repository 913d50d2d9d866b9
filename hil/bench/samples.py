# SPDX-License-Identifier: MIT
"""The samples of a loop's cycles, and their statistics: the same for every program."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from segway_ecc.hil.bench.ours import COLUMNS

LATE_FRACTION: Final = 0.1
"""A cycle is late that starts more than this part of a period after its deadline, as the loop itself counts."""

_CLOCKS: Final = 3
"""The first columns, which are points in time."""
_COARSE_NS: Final = 1_000_000
_NS_PER_S: Final = 1e9
_PERCENTILES: Final = (50.0, 99.0, 99.9, 100.0)
Samples = npt.NDArray[np.int64]
"""A row for each cycle, with the columns of `COLUMNS`."""


@dataclass(frozen=True, slots=True)
class Spread:
    """How something is distributed, s."""

    mean_s: float
    p50_s: float
    p99_s: float
    p999_s: float
    max_s: float


@dataclass(frozen=True, slots=True)
class Cycles:
    """How the cycles of a loop went.

    Attributes:
        count: Cycles looked at, without those of the warm-up.
        late: How many of them started late; see `LATE_FRACTION`.
        lost: Deadlines that passed without a cycle.
        cost: CPU time of the loop's thread from one start of a cycle to the next.
        lateness: From the deadline to the start.
        phases: Wall time of the parts that the program measures, by name.
        is_coarse: Whether the kernel counts CPU time in ticks of a millisecond or more.
    """

    count: int
    late: int
    lost: int
    cost: Spread
    lateness: Spread
    phases: dict[str, Spread]
    is_coarse: bool = False

    @property
    def typical_cost_s(self) -> float:
        """The median cost; the mean where the kernel counts CPU time in ticks too coarse for a single cycle."""
        return self.cost.mean_s if self.is_coarse else self.cost.p50_s

    @property
    def is_held(self) -> bool:
        """Whether every cycle was in time."""
        return not self.late and not self.lost


def read_samples(path: Path) -> Samples:
    """Read the samples that a program wrote.

    Raises:
        ValueError: The file does not hold whole samples.
    """
    flat = np.fromfile(path, dtype=np.int64)
    if not flat.size or flat.size % len(COLUMNS):
        raise ValueError(f"{path} holds no whole samples")
    return flat.reshape(-1, len(COLUMNS))


def spread(durations_ns: npt.NDArray[np.int64]) -> Spread:
    """The distribution of durations, each percentile a duration that occurred."""
    ranks = np.percentile(durations_ns, _PERCENTILES, method="higher") / _NS_PER_S
    return Spread(float(durations_ns.mean()) / _NS_PER_S, *(float(rank) for rank in ranks))


def cycles_of(runs: list[Samples], period_ns: int, warm_up: int) -> Cycles:
    """What the samples of one or more runs of a program come to, but for the first cycles of each, its warm-up.

    Raises:
        ValueError: A run has no two cycles after its warm-up.
    """
    kept = [run[warm_up:] for run in runs]
    if any(len(run) < 2 for run in kept):  # noqa: PLR2004 - a difference takes two
        raise ValueError(f"a run of fewer than {warm_up + 2} cycles has no statistics")
    whole = np.concatenate(kept)
    lateness = np.maximum(whole[:, 1] - whole[:, 0], 0)
    cost = np.concatenate([np.diff(run[:, 2]) for run in kept])
    ticks = cost[cost > 0]
    steps = np.concatenate([np.diff(run[:, 0]) for run in kept])
    return Cycles(
        count=len(whole),
        late=int((lateness > LATE_FRACTION * period_ns).sum()),
        lost=int((np.rint(steps / period_ns) - 1).sum()),
        cost=spread(cost),
        lateness=spread(lateness),
        phases={
            name: spread(whole[:, place])
            for place, name in enumerate(COLUMNS)
            if place >= _CLOCKS and whole[:, place].any()
        },
        is_coarse=bool(ticks.size) and int(ticks.min()) >= _COARSE_NS,
    )
