# SPDX-License-Identifier: MIT
"""A witness of how long this machine stalled: a process at ordinary priority with a thread on each processor.

Each sleeps for a moment, again and again; what it slept beyond that is time in which its processor did not run it.
"""

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from segway_ecc.hil.processes import module_words, program

STALL_S: Final = 0.02
"""The shortest gap that is a stall: the shortest time-out of a drive's watchdog."""
_SLEEP_S: Final = 0.005
_ANSWERS_WITHIN_S: Final = 60.0


@contextlib.contextmanager
def witness(messages: Path) -> Iterator[Callable[[], float]]:
    """Measure gaps while the context lasts; the witness' own messages go to a file.

    Yields:
        A function that returns the longest stall since it was called last, s; 0 where there was none.
    """
    with program(module_words(__name__), messages, name="witness", listens=True) as process:

        def longest_stall_s() -> float:
            gap_s = float(process.ask("longest gap", _ANSWERS_WITHIN_S))
            return gap_s if gap_s >= STALL_S else 0.0

        longest_stall_s()  # it has started
        yield longest_stall_s


def _measure(core: int, longest: dict[int, float]) -> None:
    os.sched_setaffinity(0, {core})
    while True:
        before_s = time.monotonic()
        time.sleep(_SLEEP_S)
        longest[core] = max(longest[core], time.monotonic() - before_s - _SLEEP_S)


def _answer() -> None:
    longest = dict.fromkeys(os.sched_getaffinity(0), 0.0)
    for core in longest:
        threading.Thread(target=_measure, args=(core, longest), daemon=True).start()
    for _question in sys.stdin:
        sys.stdout.write(f"{max(longest.values())}\n")
        sys.stdout.flush()
        longest.update(dict.fromkeys(longest, 0.0))


if __name__ == "__main__":
    _answer()
