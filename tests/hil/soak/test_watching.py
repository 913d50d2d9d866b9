# SPDX-License-Identifier: MIT
"""What a process takes, against what it surely does."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from segway_ecc.hil.process_usage import helpers_of, usage
from segway_ecc.hil.soak.watching import LOG, Counted, Watching
from segway_ecc.node.recording.log_quota import MB

SIZE = 8 << 20


GROWS: Final = f"""
import mmap, os, threading
print(flush=True); input()
held = mmap.mmap(-1, {SIZE})
for page in range(0, {SIZE}, mmap.PAGESIZE):
    held[page] = 1
files = [open(os.devnull) for _ in range(3)]
threading.Thread(target=threading.Event().wait, daemon=True).start()
print(flush=True); input()
"""
"""A process of its own: nothing but this happens in it, whatever other tests have left to end in this one."""


def test_memory_files_and_threads_of_a_process() -> None:
    with subprocess.Popen([sys.executable, "-c", GROWS], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdout.readline()
        before = usage(process.pid)
        process.stdin.write(b"\n")
        process.stdin.flush()
        process.stdout.readline()
        after = usage(process.pid)
        process.kill()
    assert before is not None
    assert after is not None
    assert after.memory_kb - before.memory_kb == pytest.approx(SIZE / 1024, abs=1024)
    assert (after.files - before.files, after.threads - before.threads) == (3, 1)
    assert after.pss_kb > SIZE / 1024


def test_helpers_are_found_and_those_that_ended_take_nothing() -> None:
    words = [sys.executable, "-c", "print(flush=True); input() # segway_ecc.node.recording.writer"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()  # it is the program by now, and no copy of this process
        assert helpers_of(os.getpid()) == {"recorder": process.pid}
        process.kill()
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        assert usage(process.pid) is None
    assert usage(process.pid) is None
    assert helpers_of(process.pid) == {}


def test_samples_become_series_and_the_log_is_held_to_its_room(tmp_path: Path) -> None:
    watching = Watching(tmp_path)
    for place in range(3):
        with (tmp_path / f"soak-{place}.mcap").open("wb") as file:
            file.truncate(MB)
        watching.look(float(place), {"node": os.getpid(), "gone": 2**22 + 1})
        watching.count(float(place), "node", Counted("objects", 100), 5.0)
    by_name = {(s.process, s.quantity): s for s in watching.series}
    assert list(by_name) == [
        ("node", "memory"),
        ("node", "proportional set size"),
        ("node", "open files"),
        ("node", "threads"),
        ("log", "room"),
        ("log", "files"),
        ("node", "objects"),
    ]
    assert by_name["log", "room"].values == [1.0, 2.0, 3.0]
    assert by_name["log", "room"].most == (LOG.total_bytes + LOG.file_bytes) / MB
    assert by_name["log", "files"].values == [1, 2, 3]
    assert by_name["node", "objects"].times_s == [0.0, 1.0, 2.0]
    assert by_name["node", "proportional set size"].allowed is None
