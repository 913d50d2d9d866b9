# SPDX-License-Identifier: MIT
"""How long a call takes, counted by a process beside it."""

import mmap
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from segway_ecc.node.watchdog import process as watchdog_process
from segway_ecc.node.watchdog.page import Call, CallPage, Seen
from segway_ecc.node.watchdog.process import WatchedProcess

PAUSE_NS = 5_000_000
LIMIT_NS = 100_000_000
STEP = Seen(Call.STEP, 3, 1000)
BUSY = "print(flush=True)\nwhile True: pass"
WAITS = "import time\nprint(flush=True)\ntime.sleep(1000)"


@contextmanager
def child(program: str) -> Iterator["subprocess.Popen[bytes]"]:
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield process
        process.kill()


def watch(started: "subprocess.Popen[bytes]") -> WatchedProcess:
    return WatchedProcess(os.pidfd_open(started.pid))


def look(process: WatchedProcess, seen: Seen) -> int:
    time.sleep(PAUSE_NS * 1e-9)
    return process.held_ns(seen, PAUSE_NS)


@pytest.mark.parametrize("program", [BUSY, WAITS])
def test_a_call_that_goes_on_is_counted(program: str) -> None:
    with child(program) as started:
        process = watch(started)
        while look(process, STEP) < LIMIT_NS:
            pass  # it ends, however busy the machine is


def test_another_call_is_counted_anew() -> None:
    with child(WAITS) as started:
        process = watch(started)
        while look(process, STEP) < LIMIT_NS:
            pass
        assert look(process, STEP._replace(since_ns=1001)) == 0
        assert look(process, Seen(Call.NONE, 3, 1001)) == 0


def test_a_process_that_is_stopped_is_not_counted() -> None:
    with child(BUSY) as started:
        process = watch(started)
        started.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, started.pid, os.WSTOPPED)
        assert [look(process, STEP) for _ in range(50)] == [0] * 50


WAITS_FOR_ITS_OWN = """
import threading
print(flush=True)
busy = threading.Thread(target=lambda: [None for _ in iter(int, 1)])
busy.start(); busy.join()
"""


def test_waiting_for_a_thread_of_its_own_counts_the_time_that_it_runs() -> None:
    with child(WAITS_FOR_ITS_OWN) as started:
        process, clock = watch(started), (~started.pid << 3) | 2
        look(process, STEP)
        before_ns = time.clock_gettime_ns(clock)
        held_ns = [look(process, STEP) for _ in range(50)][-1]
        assert held_ns <= time.clock_gettime_ns(clock) - before_ns


def test_a_watchdog_that_is_late_counts_no_more_than_two_of_its_pauses() -> None:
    with child(WAITS) as started:
        process = watch(started)
        look(process, STEP)
        time.sleep(20 * PAUSE_NS * 1e-9)
        assert process.held_ns(STEP, PAUSE_NS) <= 2 * PAUSE_NS


def test_one_that_is_gone_is_counted_no_more() -> None:
    with child(WAITS) as started:
        process = watch(started)
        while (counted_ns := look(process, STEP)) < LIMIT_NS:
            pass
        started.kill()
        started.wait()
        assert look(process, STEP) == counted_ns


def test_only_what_was_handed_over_is_ended_however_late_the_watchdog_starts(tmp_path: Path) -> None:
    page = tmp_path / "page"
    page.write_bytes(bytes(mmap.PAGESIZE))
    pipe, printed = os.pipe()
    os.write(printed, b"hello\n")
    os.close(printed)
    with child(WAITS) as gone:
        watched = os.pidfd_open(gone.pid)
        gone.kill()
    ours, theirs = socket.socketpair()
    ours.close()
    with page.open("r+b") as file, theirs:
        CallPage(file.fileno()).enter(Call.LOAD, 0, 0)
        given = watched, file.fileno(), pipe, theirs.fileno()
        words = [sys.executable, "-P", "-m", watchdog_process.__name__, *map(str, given), "tank:Tank"]
        with subprocess.Popen(words, stdin=subprocess.PIPE, stderr=subprocess.PIPE, pass_fds=given) as started:
            assert started.stderr is not None
            reported = started.stderr.read()  # what was forked may hold its tasks' pipe open, as we do
    os.close(pipe)
    os.close(watched)
    assert reported.decode().splitlines() == [
        "segway-ecc: model 'tank:Tank' printed: hello",
        "segway-ecc: the process ended while model 'tank:Tank' was loaded",
    ]


@pytest.mark.parametrize(("program", "status"), [(BUSY, -signal.SIGABRT), (WAITS, -signal.SIGABRT)])
def test_a_process_is_ended(program: str, status: int) -> None:
    with child(program) as started:
        watch(started).end()
        assert started.wait() == status


def test_one_that_does_not_end_by_itself_is_killed() -> None:
    with child(f"import signal\nsignal.signal(signal.SIGABRT, signal.SIG_IGN)\n{BUSY}") as started:
        watch(started).end()
        assert started.wait() == -signal.SIGKILL
