# SPDX-License-Identifier: MIT
"""A witness of how long this machine stalled: a process with the loops' own priority and a thread on each processor.

So what only ordinary programs wait for is no stall to loops that are above them. Each sleeps for a moment, again and
again; what it slept beyond that is time in which its processor did not run it. A process that works waits longer than
one that sleeps: of those that matter the witness also reads how long the kernel had them wait, ready to run.
"""

import contextlib
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from segway_ecc.hil.processes import Command, module_words, program
from segway_ecc.node.cycle.real_time import real_time_priority

STALL_S: Final = 0.02
"""The shortest gap that is a stall: the shortest time-out of a drive's watchdog, and two periods of the carts' loops,
after which telemetry, a period old before, is stale."""
_SLEEP_S: Final = 0.005
_ANSWERS_WITHIN_S: Final = 60.0
_WATCH: Final = "watch "


class Witness:
    """The witness process, seen from the process that started it."""

    def __init__(self, process: Command) -> None:
        """Talk to it."""
        self._process = process

    def watch(self, *processes: int) -> None:
        """Count what these processes wait for a processor, too."""
        for process in processes:
            self._process.ask(f"{_WATCH}{process}", _ANSWERS_WITHIN_S)

    def longest_stall_s(self) -> float:
        """The longest stall since it was called last, s; 0 where there was none."""
        gap_s = float(self._process.ask("longest gap", _ANSWERS_WITHIN_S))
        return gap_s if gap_s >= STALL_S else 0.0


@contextlib.contextmanager
def witness(messages: Path) -> Iterator[Witness]:
    """Measure gaps while the context lasts; the witness' own messages go to a file."""
    with program(module_words(__name__), messages, name="witness", listens=True) as process:
        found = Witness(process)
        found.longest_stall_s()  # it has started
        yield found


class Waits:
    """How long processes waited for a processor, as the kernel counts it (sched-stats.rst: /proc/PID/schedstat)."""

    def __init__(self, proc: Path = Path("/proc")) -> None:
        """Watch none yet."""
        self._proc = proc
        self._added: deque[int] = deque()
        self._waited_s: dict[int, float] = {}

    def add(self, process: int) -> None:
        """Watch one from now on; may be called from another thread."""
        self._added.append(process)

    def longest_s(self, elapsed_s: float) -> float:
        """The least that the longest wait took of those that ended since this was called last, `elapsed_s` ago.

        The kernel counts a wait when it ends: what was counted is this one, and others that took no longer than that.
        """
        before_s = {**{process: self._read_s(process) for process in self._taken()}, **self._waited_s}
        self._waited_s = {process: self._read_s(process) for process in before_s}
        return max((self._waited_s[process] - was_s for process, was_s in before_s.items()), default=0.0) - elapsed_s

    def _taken(self) -> Iterator[int]:
        while self._added:
            yield self._added.popleft()

    def _read_s(self, process: int) -> float:
        """All that it has waited; as before where it has ended or the kernel keeps no accounts."""
        try:
            return int((self._proc / str(process) / "schedstat").read_text("ascii").split()[1]) * 1e-9
        except (OSError, IndexError, ValueError):
            return self._waited_s.get(process, 0.0)


def _measure(core: int, longest: dict[int | str, float]) -> None:
    os.sched_setaffinity(0, {core})
    with real_time_priority():
        while True:
            before_s = time.monotonic()
            time.sleep(_SLEEP_S)
            longest[core] = max(longest[core], time.monotonic() - before_s - _SLEEP_S)


def _follow(waits: Waits, longest: dict[int | str, float]) -> None:
    with real_time_priority():
        before_s = time.monotonic()
        while True:
            time.sleep(_SLEEP_S)
            now_s = time.monotonic()
            longest[_WATCH] = max(longest[_WATCH], waits.longest_s(now_s - before_s))
            before_s = now_s


def _answer() -> None:
    cores = os.sched_getaffinity(0)
    longest: dict[int | str, float] = dict.fromkeys([_WATCH, *cores], 0.0)
    waits = Waits()
    for core in cores:
        threading.Thread(target=_measure, args=(core, longest), daemon=True).start()
    threading.Thread(target=_follow, args=(waits, longest), daemon=True).start()
    for question in sys.stdin:
        process = question.removeprefix(_WATCH).strip()
        if process.isdigit():
            waits.add(int(process))
        sys.stdout.write(f"{max(longest.values())}\n")
        sys.stdout.flush()
        if not process.isdigit():
            longest.update(dict.fromkeys(longest, 0.0))


if __name__ == "__main__":
    _answer()
