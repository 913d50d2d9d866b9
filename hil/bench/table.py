# SPDX-License-Identifier: MIT
"""What was measured, as text, and what the loop is to be: ratios of figures from one run.

A machine that is twice as slow changes none of these.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from segway_ecc.hil.bench.comparison import ProgramResult, SustainedRates
from segway_ecc.hil.bench.contestants import Contestant
from segway_ecc.hil.bench.samples import Spread
from segway_ecc.hil.bench.speed import CAMPAIGN_WANTED, SEGWAY_WANTED, CampaignSpeed, LockStep
from segway_ecc.hil.text_table import aligned

TITLES: Final = {
    Contestant.OURS: "ours",
    Contestant.USER: "user's loop",
    Contestant.C: "loop in C",
    Contestant.BARE: "bare loop in C",
}
COST_OF_USERS: Final = 0.25
COST_OF_LIMIT: Final = 6.0
LATENESS_OF_BARE: Final = 1.5
ENOUGH_CYCLES: Final = 3000
"""For a p99.9 of something: with fewer, two or three cycles decide it."""
_MB: Final = 1e6
_PHASES: Final = ("bus", "ros", "decide", "model", "limit", "record", "cycle")


@dataclass(frozen=True, slots=True)
class Claim:
    """A ratio, of what is divided by what, and the most that it may be."""

    what: str
    ratio: float
    limit: float

    @property
    def is_met(self) -> bool:
        """Whether it is no more."""
        return self.ratio <= self.limit

    def as_text(self) -> str:
        """One line."""
        return f"{self.what}: {self.ratio:.2f}, at most {self.limit:g} wanted: {_met(self.is_met)}"


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


def comparison_text(results: Mapping[Contestant, ProgramResult]) -> str:
    """Cost and lateness, what the processes take, and the wall time of the parts of a cycle."""
    head = ["", "cost: mean", "p50", "p99", "p99.9", "max", "late by: p50", "p99", "p99.9", "max", "late", "lost", "of"]
    timing, takes, parts = [], [], []
    for who, result in results.items():
        cycles, memory = result.cycles, result.memory
        mean, counts = f"{cycles.cost.mean_s * 1e6:.1f}", map(str, (cycles.late, cycles.lost, cycles.count))
        timing.append([TITLES[who], mean, *_us(cycles.cost), *_us(cycles.lateness), *counts])
        start = "-" if result.start_s is None else f"{result.start_s:.2f} s"
        held = (f"{size / _MB:.0f} MB" for size in (memory.pss, memory.rss))
        takes.append([TITLES[who], f"{result.share * 100.0:.1f} %", *held, start])
        if cycles.phases:
            spreads = (cycles.phases.get(name) for name in _PHASES)
            parts.append([TITLES[who], *(f"{s.p50_s * 1e6:.1f}/{s.p99_s * 1e6:.1f}" if s else "-" for s in spreads)])
    return "\n".join(
        (
            "CPU time of the loop's thread between wake-ups, and wake-up lateness, in microseconds; cycles:",
            _indented([head, *timing]),
            "of the process with its children:",
            _indented([["", "share of a core", "PSS", "RSS", "first command after"], *takes]),
            "wall time of the parts of a cycle, p50/p99 in microseconds:",
            _indented([["", *_PHASES], *parts]),
        )
    )


def held_text(held: Mapping[Contestant, SustainedRates], hold_s: float) -> str:
    """The highest rates, and how many cycles were late or lost at each."""
    rates = sorted({rate for one in held.values() for rate in one.tried})
    head = ["", *(f"{rate:g} Hz" for rate in rates), "none late up to", "none lost up to"]
    rows = []
    for who, one in held.items():
        cells = [TITLES[who]]
        for rate_hz in rates:
            cycles = one.tried.get(rate_hz)
            gave_up = " gave up" if rate_hz in one.faults else ""
            cells.append("-" if cycles is None else f"{cycles.late}/{cycles.lost}{gave_up}")
        rows.append([*cells, f"{one.in_time_hz:g} Hz", f"{one.complete_hz:g} Hz"])
    return f"late/lost cycles at each rate, held for {hold_s:g} s:\n{_indented([head, *rows])}"


def lock_step_text(measured: Sequence[LockStep]) -> str:
    """One line for each robot."""
    lines = []
    for one in measured:
        wanted = f", at least {SEGWAY_WANTED:g} wanted: {_met(one.times_real_time >= SEGWAY_WANTED)}"
        lines.append(
            f"lock step of {one.robot} at {one.rate_hz:g} Hz: {one.simulated_s:g} s in {one.median_s:.3f} s, "
            f"{one.times_real_time:.0f} times real time{wanted if one.robot == 'segway' else ''}"
        )
    return "\n".join(lines)


def campaign_text(speed: CampaignSpeed) -> str:
    """One line."""
    return (
        f"campaign: {speed.runs_per_s:.1f} runs a second, {speed.jobs} at a time ({speed.runs} runs of {speed.of}), "
        f"at least {CAMPAIGN_WANTED:g} wanted on two cores: {_met(speed.runs_per_s >= CAMPAIGN_WANTED)}"
    )


def model_text(cost: Mapping[str, float]) -> str:
    """One line."""
    return (
        f"native model: a step costs {cost['through_our_interface_s'] * 1e6:.2f} us through our interface and "
        f"{cost['native_s'] * 1e6:.2f} us from C (medians); loaded in {cost['load_first_s']:.2f} s the first time and "
        f"{cost['load_from_cache_s'] * 1e3:.0f} ms from the cache"
    )


def links_text(cost: dict[str, float]) -> str:
    """One line."""
    return (
        f"CAN links: 4 frames in and 2 out in a cycle cost {cost['python_can_us']:.0f} us through python-can, "
        f"{cost['raw_us']:.0f} us through a raw socket, {cost['ratio']:.1f} times faster (medians, on vcan)"
    )


def _met(met: bool) -> str:  # noqa: FBT001 - a private word for a verdict
    return "met" if met else "NOT met"


def _us(spread: Spread) -> list[str]:
    return [f"{value * 1e6:.1f}" for value in (spread.p50_s, spread.p99_s, spread.p999_s, spread.max_s)]


def _indented(rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(f"  {line}" for line in aligned(rows, left=1))
