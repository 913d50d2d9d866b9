# SPDX-License-Identifier: MIT
"""A witness of how this machine stalled: a process with the loops' own priority and a thread on each processor.

So what only ordinary programs wait for is no stall to loops that are above them. Each sleeps for a moment, again and
again; what it slept beyond that is time in which its processor did not run it. A process that works waits longer than
one that sleeps: of those that matter the witness also reads how long the kernel had them wait, ready to run, and how
long they did nothing although nothing kept them from it, which is no stall of the machine.
"""

import contextlib
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from segway_ecc.hil.processes import Command, module_words, program
from segway_ecc.node.cycle.real_time import real_time_priority

STALL_S: Final = 0.02
"""The shortest gap that is a stall: the shortest time-out of a drive's watchdog, and two periods of the carts' loops,
after which telemetry, a period old before, is stale."""
CROWDED_S: Final = 0.2
"""Gaps of a second that add up to more are as bad: the carts' loops give up where 40 deadlines of a second, 5 ms each,
are missed."""
IDLE_S: Final = 0.2
"""A process with a deadline every few milliseconds that does nothing for longer was stopped, or hangs."""
_SLEEP_S: Final = 0.005
_SECOND_S: Final = 1.0
_ANSWERS_WITHIN_S: Final = 60.0
_WATCH: Final = "watch "
_RESTING: Final = "ST"
"""States of a process (proc_pid_stat(5)) that sleeps, or was stopped; not one that runs, waits to, or awaits a disk."""


class Stalls(NamedTuple):
    """What the witness saw.

    Attributes:
        longest_s: The longest gap.
        in_a_second_s: The most that gaps added up to within a second.
        idle_s: The longest time in which each process that is watched did nothing, and nothing kept it from it.
    """

    longest_s: float = 0.0
    in_a_second_s: float = 0.0
    idle_s: tuple[float, ...] = ()

    @property
    def stall_s(self) -> float:
        """The longest gap where it is a stall; 0 where there was none."""
        return self.longest_s if self.longest_s >= STALL_S else 0.0

    @property
    def text(self) -> str:
        """How the machine stalled, empty where it did not; shorter gaps than a stall are left out."""
        if self.stall_s:
            return f"the machine stalled for up to {self.stall_s * 1e3:.0f} ms"
        if self.in_a_second_s >= CROWDED_S:
            return f"the machine stalled for {self.in_a_second_s * 1e3:.0f} ms of a second"
        return ""


class Witness:
    """The witness process, seen from the process that started it."""

    def __init__(self, process: Command) -> None:
        """Talk to it."""
        self._process = process

    def watch(self, *processes: int) -> None:
        """Count what these processes wait for a processor, too, and how long they do nothing."""
        for process in processes:
            self._process.ask(f"{_WATCH}{process}", _ANSWERS_WITHIN_S)

    def stalls(self) -> Stalls:
        """What happened since it was called last."""
        return msgspec.json.decode(self._process.ask("stalls", _ANSWERS_WITHIN_S), type=Stalls)


@contextlib.contextmanager
def witness(messages: Path) -> Iterator[Witness]:
    """Measure gaps while the context lasts; the witness' own messages go to a file."""
    with program(module_words(__name__), messages, name="witness", listens=True) as process:
        found = Witness(process)
        found.stalls()  # it has started
        yield found


class Gaps:
    """What kept one thread or process from running, as it comes.

    Attributes:
        longest_s: The longest gap.
        in_a_second_s: The most that gaps added up to within a second.
    """

    def __init__(self) -> None:
        """None yet."""
        self.longest_s = self.in_a_second_s = 0.0
        self._recent: deque[tuple[float, float]] = deque()
        self._sum_s = 0.0

    def add(self, now_s: float, gaps_s: float, longest_s: float) -> None:
        """Take what gaps that have just ended add up to, and how long the longest was at least."""
        self.longest_s = max(self.longest_s, longest_s)
        self._recent.append((now_s, gaps_s))
        self._sum_s += gaps_s
        while now_s - self._recent[0][0] >= _SECOND_S:
            self._sum_s -= self._recent.popleft()[1]
        self.in_a_second_s = max(self.in_a_second_s, self._sum_s)

    def clear(self) -> None:
        """Forget the most; what is within the last second may still add up."""
        self.longest_s = self.in_a_second_s = 0.0


class Account(NamedTuple):
    """What the kernel says of a process: sched-stats.rst for /proc/PID/schedstat, proc_pid_stat(5) for its state."""

    ran_ns: int
    waited_ns: int
    slices: int
    state: str


class Watched:
    """A process that matters, as the kernel accounts for it.

    Attributes:
        gaps: Its waits for a processor.
        longest_idle_s: The longest time in which it did nothing, and nothing kept it from it.
    """

    def __init__(self, process: int, proc: Path = Path("/proc")) -> None:
        """Watch it from now on."""
        self._folder = proc / str(process)
        self._account = self._read()
        self._idle_s = 0.0
        self.gaps = Gaps()
        self.longest_idle_s = 0.0

    def look(self, now_s: float, elapsed_s: float) -> None:
        """Read its account; called every `_SLEEP_S`, this time `elapsed_s` after the last one.

        The kernel counts a wait when it ends: of those that ended meanwhile the longest took what was counted, less
        what there was time for besides.
        """
        before, self._account = self._account, self._read() or self._account
        if before is None or self._account is None:
            return
        waited_s = (self._account.waited_ns - before.waited_ns) * 1e-9
        self.gaps.add(now_s, waited_s, waited_s - elapsed_s)
        if self._account == before and before.state in _RESTING:
            self._idle_s += min(elapsed_s, STALL_S)  # in what is more nobody ran
        else:
            self._idle_s = 0.0
        self.longest_idle_s = max(self.longest_idle_s, self._idle_s)

    def _read(self) -> Account | None:
        """None where it has ended, or the kernel keeps no accounts."""
        try:
            ran, waited, slices = (self._folder / "schedstat").read_text("ascii").split()
            state = (self._folder / "stat").read_text("utf-8", "replace").rpartition(") ")[2][:1]
            return Account(int(ran), int(waited), int(slices), state)
        except (OSError, ValueError):
            return None


def _measure(core: int, gaps: Gaps) -> None:
    os.sched_setaffinity(0, {core})
    with real_time_priority():
        while True:
            before_s = time.monotonic()
            time.sleep(_SLEEP_S)
            now_s = time.monotonic()
            gap_s = now_s - before_s - _SLEEP_S
            gaps.add(now_s, gap_s, gap_s)


def _follow(watched: list[Watched]) -> None:
    with real_time_priority():
        before_s = time.monotonic()
        while True:
            time.sleep(_SLEEP_S)
            now_s = time.monotonic()
            for process in tuple(watched):
                process.look(now_s, now_s - before_s)
            before_s = now_s


def _answer() -> None:
    cores = {core: Gaps() for core in os.sched_getaffinity(0)}
    watched: list[Watched] = []
    for core, gaps in cores.items():
        threading.Thread(target=_measure, args=(core, gaps), daemon=True).start()
    threading.Thread(target=_follow, args=(watched,), daemon=True).start()
    for question in sys.stdin:
        process = question.removeprefix(_WATCH).strip()
        every = [*cores.values(), *(each.gaps for each in watched)]
        found = Stalls(
            max(gaps.longest_s for gaps in every),
            max(gaps.in_a_second_s for gaps in every),
            tuple(each.longest_idle_s for each in watched),
        )
        if process.isdigit():
            watched.append(Watched(int(process)))
        else:
            for gaps in every:
                gaps.clear()
            for each in watched:
                each.longest_idle_s = 0.0
        sys.stdout.buffer.write(msgspec.json.encode(found) + b"\n")
        sys.stdout.flush()


if __name__ == "__main__":
    _answer()
