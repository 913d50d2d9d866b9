# SPDX-License-Identifier: MIT
"""The process that watches calls into a model: its tasks come through its standard input, the calls through a page.

It ends a process whose call does not return in time, and reports that, or that the process has ended in a call. What
the model prints arrives through a pipe, so that printing never waits for whoever reads it.

Times are counted so that a machine that stalls is not taken for a model that does: while the process could run and was
not running, only the processor time counts that it had.
"""

import contextlib
import os
import select
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.node.cycle.real_time import PRIORITY
from segway_ecc.node.watchdog.exits import Exits, receive_exits
from segway_ecc.node.watchdog.output import ModelOutput
from segway_ecc.node.watchdog.page import NAMES, Call, CallPage, Seen

LONG_NS: Final = 10_000_000_000
"""What a call may take that no cycle waits for, ns: the initial and the final equations."""
_LOOKS: Final = 4
"""So often within the limit it is looked at."""
_LONGEST_PAUSE_NS: Final = 50_000_000
_KILL_AFTER_S: Final = 5.0
_OUTPUT_S: Final = 10.0
_READ_BYTES: Final = 65_536
_MESSAGES: Final = 2
_NS_PER_S: Final = 1_000_000_000
_WAITS: Final = {"S", "Z"}
"""The states of a thread that waits, and of the first one of a process where that has ended by itself."""


class WatchTask(msgspec.Struct, frozen=True):
    """What is watched; a new one replaces the one before.

    Attributes:
        name: The model, as it is called in messages.
        inputs: The names of its inputs.
        limit_ns: What a call may take that a cycle waits for, ns.
        is_over: Whether nothing is watched any more: the process goes on without the model, or ends as it should.
    """

    name: str
    inputs: tuple[str, ...] = ()
    limit_ns: int = LONG_NS
    is_over: bool = False


class WatchedProcess:
    """A process of which a call is timed.

    Attributes:
        pidfd: Its descriptor, which can be read from when it has ended. A number would be given to another in time, and
            the parent of a process whose own has ended is init, or whoever looks after orphans.
    """

    def __init__(self, pidfd: int) -> None:
        """Watch the process of this descriptor (pidfd_open(2)), which may have ended."""
        info = Path(f"/proc/self/fdinfo/{pidfd}").read_text()
        pid = int(info.partition("\nPid:")[2].split()[0])  # -1 where it has ended and was waited for: proc(5)
        self.pidfd = pidfd
        self._threads = Path(f"/proc/{pid}/task")
        self._clock = (~pid << 3) | 2  # CLOCK_PROCESS_CPUTIME_ID of another process: clock_getcpuclockid(3)
        self._seen: Seen | None = None
        self._used_ns: int | None = None
        self._looked_ns = self._held_ns = 0

    def held_ns(self, seen: Seen, pause_ns: int) -> int:
        """How long the call has taken that was seen now, `pause_ns` after the look before, ns."""
        now_ns = time.monotonic_ns()
        if seen.call is Call.NONE or seen != self._seen:
            self._held_ns, self._used_ns = 0, None
        else:
            used_ns = self._time_used_ns()
            passed_ns = min(now_ns - self._looked_ns, 2 * pause_ns)  # what we were late by is nobody's fault
            states = self._states()
            if states and states <= _WAITS:  # for something that does not come from this process
                self._held_ns += passed_ns
            elif states.isdisjoint("Tt") and used_ns is not None and self._used_ns is not None:
                self._held_ns += min(used_ns - self._used_ns, passed_ns)
            self._used_ns = used_ns
        self._seen, self._looked_ns = seen, now_ns
        return self._held_ns

    def end(self) -> None:
        """End it: with the traceback and the core of an abort, where it can still give one."""
        for number, wait_s in ((signal.SIGABRT, _KILL_AFTER_S), (signal.SIGKILL, _OUTPUT_S)):
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self.pidfd, number)
            if select.select([self.pidfd], [], [], wait_s)[0]:
                return

    def has_thread(self, number: int) -> bool:
        """Whether the thread of this number is one of its own."""
        return (self._threads / str(number)).exists()

    def _time_used_ns(self) -> int | None:
        try:
            return time.clock_gettime_ns(self._clock)
        except OSError:  # it has ended
            return None

    def _states(self) -> set[str]:
        """Those of its threads, as proc(5) has them: it may wait for one of its own, which waits for a processor."""
        found = set()
        for stat in self._threads.glob("*/stat"):
            with contextlib.suppress(OSError):  # it has ended
                found.add(stat.read_text().rpartition(")")[2].split()[0])
        return found


class ModelWatcher:
    """Watches one process until it has ended, or nothing is to be watched any more.

    Attributes:
        exits: Where the process asks before it ends with status 0; None where the kernel does not have it ask.
    """

    def __init__(
        self, source: int, page: CallPage, process: WatchedProcess, output: ModelOutput, task: WatchTask
    ) -> None:
        """Begin with `task`; take others from the file descriptor `source`."""
        self.exits: Exits | None = None
        self._source = source
        self._page = page
        self._process = process
        self._output = output
        self._task = task
        self._received = b""

    def run(self) -> str:
        """Watch; returns what is to be reported of how it ended, empty for nothing."""
        sources = [self._source, self._process.pidfd]
        if self.exits is not None:
            sources.append(self.exits.descriptor)
        while not self._task.is_over:
            pause_ns = min(self._task.limit_ns // _LOOKS, _LONGEST_PAUSE_NS)
            ready = select.select(sources, [], [], pause_ns / _NS_PER_S)[0]
            if self._source in ready:
                sent = os.read(self._source, _READ_BYTES)
                if not sent:
                    return self._ended()
                self._take(sent)
            elif self.exits is not None and ready and not self.exits.answer(self._may_end):
                return self._end("it ended the process with status 0, as by _exit")
            elif self._process.pidfd in ready and not select.select([self._source], [], [], 0.0)[0]:
                return self._ended()  # and what it has forked holds its files open
            seen = self._page.look()
            limit_ns = self._limit_ns(seen.call)
            if limit_ns and self._process.held_ns(seen, pause_ns) > limit_ns:
                return self._end(f"it did not return within {limit_ns / _NS_PER_S:g} s, and its process was ended")
        return ""

    def _may_end(self, thread: int) -> bool:
        """Others may, which the process has started."""
        return not self._process.has_thread(thread)

    def _end(self, cause: str) -> str:
        seen = self._page.look()
        self._process.end()
        self._output.finish(_OUTPUT_S)
        return f"{self._where(seen)}: {cause}{self._output.place}"

    def _take(self, sent: bytes) -> None:
        *lines, self._received = (self._received + sent).split(b"\n")
        for line in lines:
            self._task = msgspec.json.decode(line, type=WatchTask)
            self._output.name = self._task.name
            self._page.resize(len(self._task.inputs))

    def _limit_ns(self, call: Call) -> int:
        if call in {Call.NONE, Call.LOAD}:  # what loads a model compiles it, and Ctrl-C ends it
            return 0
        return LONG_NS if call in {Call.INITIALIZE, Call.TERMINATE} else self._task.limit_ns

    def _ended(self) -> str:
        """The process has ended, with nobody having said that it would, or another program has taken its place."""
        self._process.end()
        self._output.finish(_OUTPUT_S)
        fault, seen = self._output.reason, self._page.look()
        if seen.call is Call.LOAD and not fault:  # as by Ctrl-C
            return f"the process ended while {self._model} was loaded"
        if seen.call is Call.NONE and not fault:
            return f"{self._where(seen)}, without a reason (as by a timer's signal, or a kill)"
        return f"{self._where(seen)}: {fault or 'its process ended without a reason (as by _exit, exec, or a kill)'}"

    @property
    def _model(self) -> str:
        return f"model '{self._task.name}'"

    def _where(self, seen: Seen) -> str:
        if seen.call is Call.LOAD:
            return f"{self._model} failed {NAMES[seen.call]}"
        if seen.call is Call.NONE:
            return f"the process ended after cycle {seen.cycle}, outside of the calls into {self._model}"
        inputs = self._page.inputs_text(self._task.inputs)
        return f"{self._model} failed {NAMES[seen.call]} of cycle {seen.cycle} ({inputs})"


def main() -> int:
    """Run as a process: `PROCESS PAGE OUTPUT EXITS`, file descriptors, and what model is loaded at first."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGABRT):  # which end what is watched, and are to be reported
        signal.signal(number, signal.SIG_IGN)
    pidfd, page, pipe, handed = map(int, sys.argv[1:5])
    task = WatchTask(sys.argv[5])
    output = ModelOutput(pipe, _write, name=task.name)
    threading.Thread(target=output.run, daemon=True).start()
    with contextlib.suppress(OSError):  # above the loop, which a call that never returns would not leave
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY + 1))
    watcher = ModelWatcher(sys.stdin.fileno(), CallPage(page), WatchedProcess(pidfd), output, task)
    watcher.exits = receive_exits(handed)
    report = watcher.run()
    output.finish(_OUTPUT_S)
    output.close(has_failed=bool(report))
    if report:
        _write(f"segway-ecc: {report}\n")
    if watcher.exits is not None:
        watcher.exits.answer_to_the_end()
    return 0


def _write(text: str) -> None:
    with contextlib.suppress(OSError):  # a message that cannot be written is lost
        os.write(_MESSAGES, text.encode(errors="backslashreplace"))


if __name__ == "__main__":
    sys.exit(main())
