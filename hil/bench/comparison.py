# SPDX-License-Identifier: MIT
"""Our loop beside the one a user would write and the least that does the work, in turns, in one run.

At given rates, and up to the highest rate that each holds: no cycle late, no deadline lost.
"""

import contextlib
import itertools
import statistics
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.clock import NS_PER_S
from segway_ecc.hil.bench.contestants import BenchSite, Contestant, ProgramRun, listening, plant, run_contestant
from segway_ecc.hil.bench.rig import Bus, Conditions, make_rig
from segway_ecc.hil.bench.samples import Cycles, Spread, cycles_of
from segway_ecc.hil.process_usage import Memory

RATES_HZ: Final = (100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0, 10000.0)
SEARCHED: Final = (Contestant.OURS, Contestant.USER, Contestant.C)
_HOPELESS: Final = 0.01
"""A program that is late, or loses, in more than this part of its cycles is not tried at a higher rate."""
_WARM_UP_S: Final = 0.5
_COMMON_NAMES: Final = {"exchange": "bus", "equations": "model"}
"""Of the parts that the others have too, by what our loop calls them; ours has more."""


@dataclass(frozen=True, slots=True)
class ProgramResult:
    """What a program cost over all its runs.

    Attributes:
        cycles: How its cycles went.
        share: CPU time of the process and its children for each second; 1 is a whole core. The median of the runs.
        memory: What they held, the most of the runs.
        start_s: From its start to its first command; the median, None where it sends none.
        fault: Why it gave up in one of its runs, so that its cost is not comparable; None where it did not.
    """

    cycles: Cycles
    share: float
    memory: Memory
    start_s: float | None
    fault: str | None = None


@dataclass(frozen=True, slots=True)
class ComparisonSetup:
    """What every comparison of one run of the bench shares; `report` is called with what is about to run."""

    bus: Bus
    conditions: Conditions
    report: Callable[[str], None]


def compare(
    setup: ComparisonSetup,
    rate_hz: float,
    duration_s: float,
    repeats: int,
    who: Sequence[Contestant] = tuple(Contestant),
) -> dict[Contestant, ProgramResult]:
    """Run the programs in turns at one rate.

    Args:
        setup: Where, and under which conditions.
        rate_hz: Cycles per second.
        duration_s: Of one run.
        repeats: Runs of each; every other time in the opposite order, so that what drifts falls on all.
        who: Which programs.

    Raises:
        ConfigurationError: One of them does not run here.
    """
    period_ns = round(NS_PER_S / rate_hz)
    runs: dict[Contestant, list[ProgramRun]] = {one: [] for one in who}
    with tempfile.TemporaryDirectory(prefix="segway-ecc-bench-") as name:
        place = BenchSite(make_rig(Path(name), period_ns), setup.bus, setup.conditions, Path(name))
        subscriber = listening() if setup.conditions.is_subscribed else contextlib.nullcontext()
        with plant(place) as seen, subscriber:
            for repeat in range(repeats):
                for one in reversed(who) if repeat % 2 else who:
                    setup.report(f"{one} at {rate_hz:g} Hz, {duration_s:g} s ({repeat + 1} of {repeats})")
                    runs[one].append(run_contestant(one, place, duration_s))
        setup.report(f"the plant: {seen}")
        return {one: _result(ran, period_ns) for one, ran in runs.items()}


def _result(runs: Sequence[ProgramRun], period_ns: int) -> ProgramResult:
    warm_up = round(_WARM_UP_S * NS_PER_S / period_ns)
    cycles = cycles_of([run.samples for run in runs], period_ns, warm_up)
    reports = [run.report for run in runs if run.report is not None]
    if reports:
        # The phases as our loop counts them itself, of the last run; what only ours has, under its own name.
        phases = {
            _COMMON_NAMES.get(phase, phase): Spread(**{part: summary[part] for part in Spread.__dataclass_fields__})
            for phase, summary in reports[-1]["timing"].items()
            if phase != "lateness"
        }
        cycles = replace(cycles, phases=phases)
    starts = [run.start_s for run in runs if run.start_s is not None]
    return ProgramResult(
        cycles,
        statistics.median(run.share for run in runs),
        max((run.memory for run in runs), key=lambda held: held.pss),
        statistics.median(starts) if starts else None,
        next((run.fault for run in runs if run.fault is not None), None),
    )


@dataclass(frozen=True, slots=True)
class SustainedRates:
    """How a program did at the rates, Hz, that it was tried at: its cycles at each, and why it gave up where it did."""

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
        held = itertools.takewhile(lambda hz: hz not in self.faults and is_good(self.tried[hz]), sorted(self.tried))
        return max(held, default=0.0)


def search(
    setup: ComparisonSetup, hold_s: float, who: Sequence[Contestant] = SEARCHED, rates_hz: Sequence[float] = RATES_HZ
) -> dict[Contestant, SustainedRates]:
    """Try the rates from the lowest up, each held for `hold_s`; who fails one by far is not tried at the next.

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
            failed = max(result.cycles.late, result.cycles.lost) > _HOPELESS * result.cycles.count
            if failed or result.fault is not None:
                left.remove(one)
        if not left:
            break
    return found
