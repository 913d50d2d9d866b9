# SPDX-License-Identifier: MIT
"""What the motors gave, tick by tick, as `segway-ecc plant --trace` writes it."""

import csv
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Final, NamedTuple

from segway_ecc.hil.rig.simulation import Trace

_STAMPS: Final = ("monotonic_ns", "wall_ns")
NOTHING: Final = 1e-4
"""N m or V that drive nothing: a current dies away exponentially, and is never quite zero. The cart needs 0.01 N m."""


class Tick(NamedTuple):
    """One tick of the drives' firmware: when it began (monotonic, ns), and whether it left any motor driven."""

    monotonic_ns: int
    is_driven: bool


class Torque(NamedTuple):
    """What became of the torque after a fault.

    Attributes:
        last_s: From the fault to the last tick with torque, s; 0 where there was none after it.
        zero_s: From the fault to the first tick of the torque-free end, s; None where torque went on to the end.
        gap_s: Longest time without torque between two ticks that had it, s.
    """

    last_s: float
    zero_s: float | None
    gap_s: float


def writer(file: IO[str], inputs: Sequence[str]) -> Trace:
    """Write each tick as a line of CSV; `file` is to be line-buffered where somebody looks on."""
    file.write(",".join([*_STAMPS, *inputs]) + "\n")

    def write(monotonic_ns: int, wall_ns: int, values: Sequence[float]) -> None:
        file.write(",".join([str(monotonic_ns), str(wall_ns), *map(repr, values)]) + "\n")

    return write


def read(path: Path) -> list[Tick]:
    """The ticks so far; a last line that is not whole yet is left out."""
    if not path.exists():
        return []
    text = path.read_text(encoding="ascii")
    rows = list(csv.reader(text[: text.rfind("\n") + 1].splitlines()))[1:]
    return [Tick(int(row[0]), any(abs(float(value)) > NOTHING for value in row[len(_STAMPS) :])) for row in rows]


def driven_since_ns(ticks: Sequence[Tick]) -> int | None:
    """When the motors were driven first; None where they never were."""
    return next((tick.monotonic_ns for tick in ticks if tick.is_driven), None)


def torque_after(ticks: Sequence[Tick], fault_ns: int, until_ns: int) -> Torque:
    """What became of the torque between a fault and the end of looking."""
    seen = [tick for tick in ticks if fault_ns < tick.monotonic_ns <= until_ns]
    driven = [index for index, tick in enumerate(seen) if tick.is_driven]
    after = driven[-1] + 1 if driven else 0
    zero_ns = seen[after].monotonic_ns if after < len(seen) else None
    stamps = [fault_ns, *(seen[index].monotonic_ns for index in driven)]
    # A gap: ticks without torque lie before a driven one.
    gaps = [
        later - earlier
        for (earlier, later), (before, place) in zip(
            itertools.pairwise(stamps), itertools.pairwise([-1, *driven]), strict=True
        )
        if place - before > 1
    ]
    return Torque(
        last_s=(stamps[-1] - fault_ns) * 1e-9,
        zero_s=None if zero_ns is None else (zero_ns - fault_ns) * 1e-9,
        gap_s=max(gaps, default=0) * 1e-9,
    )
