# SPDX-License-Identifier: MIT
"""Our own command, with a clock that keeps what it shows at each wake-up: arguments SAMPLES WORD ...

Nothing else is changed: the loop asks its clock to sleep once a cycle, and there the samples are taken.
"""

import array
import sys
import time
from pathlib import Path
from typing import ClassVar, Final

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.node.cli.main import main
from segway_ecc.node.verbs import run

COLUMNS: Final = ("deadline", "start", "cpu", "bus", "model", "ros", "cycle")
"""Of a sample, each ns in a signed 64-bit integer of this machine: when the cycle was due and when it started
(monotonic), the CPU time that its thread had used by then, the wall time of its parts (0 where it has none, or does not
measure it), and the wall time of all it did."""
_sleep_until_ns: Final = RealClock.sleep_until_ns
_TAKEN: Final = 3
"""Columns of a sample; the others, our loop reports in its own way."""


class SamplingClock(RealClock):
    """The machine's clock, which keeps a sample each time it has slept, of the first columns of `COLUMNS`."""

    samples: "ClassVar[array.array[int]]" = array.array("q")

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Sleep, and keep a sample."""
        _sleep_until_ns(self, deadline_ns)
        self.samples.extend((deadline_ns, self.now_ns(), time.thread_time_ns()))


def whole(taken: "array.array[int]") -> "array.array[int]":
    """Samples with all their columns, those that were not taken 0."""
    samples = array.array("q", bytes(len(taken) // _TAKEN * len(COLUMNS) * taken.itemsize))
    for place in range(_TAKEN):
        samples[place :: len(COLUMNS)] = taken[place::_TAKEN]
    return samples


if __name__ == "__main__":
    _, file, *words = sys.argv
    run.RealClock = SamplingClock  # type: ignore[attr-defined]  # the verb makes its clock of this name
    code = main(words)
    Path(file).write_bytes(whole(SamplingClock.samples).tobytes())
    sys.exit(code)
