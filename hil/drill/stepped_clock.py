# SPDX-License-Identifier: MIT
"""Our command, with a wall clock that steps by an hour: `python -P -m segway_ecc.hil.drill.stepped_clock VERB ...`.

CLOCK_REALTIME belongs to the whole machine and no namespace covers it, so it is not set: what is stepped is what this
process reads. SIGUSR1 steps it ahead, SIGUSR2 back. The monotonic clock is left alone, as by a real step.
"""

import signal
import sys
import time
from collections.abc import Callable
from typing import Final

from segway_ecc.node.cli.main import main

STEP_NS: Final = 3_600_000_000_000
AHEAD: Final = signal.SIGUSR1
BACK: Final = signal.SIGUSR2


def install() -> Callable[[int], int]:
    """Have every later reading of the wall clock stepped by the signals; returns the reader that was there."""
    read = time.clock_gettime_ns
    offset_ns = 0

    def stepped(clock: int) -> int:
        return read(clock) + (offset_ns if clock == time.CLOCK_REALTIME else 0)

    def step(number: int, _frame: object) -> None:
        nonlocal offset_ns
        offset_ns += STEP_NS if number == AHEAD else -STEP_NS

    time.clock_gettime_ns = stepped
    signal.signal(AHEAD, step)
    signal.signal(BACK, step)
    return read


if __name__ == "__main__":
    install()
    sys.exit(main())
