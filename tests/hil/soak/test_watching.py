# SPDX-License-Identifier: MIT
"""What a process takes, against what it surely does."""

import mmap
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from segway_ecc.hil.process_usage import children, usage
from segway_ecc.hil.soak.watching import LOG, Counted, Watching, helpers_of
from segway_ecc.node.recording.log_quota import MB

SIZE = 8 << 20


def test_memory_files_and_threads_of_this_process() -> None:
    before = usage(os.getpid())
    assert before is not None
    held = mmap.mmap(-1, SIZE)
    for page in range(0, SIZE, mmap.PAGESIZE):
        held[page] = 1
    files = [Path(os.devnull).open() for _ in range(3)]  # noqa: SIM115 - closed below
    go = threading.Event()
    thread = threading.Thread(target=go.wait)
    thread.start()
    after = usage(os.getpid())
    go.set()
    thread.join()
    for file in files:
        file.close()
    held.close()
    assert after is not None
    assert after.memory_kb - before.memory_kb == pytest.approx(SIZE / 1024, abs=1024)
    assert (after.files - before.files, after.threads - before.threads) == (3, 1)
    assert after.pss_kb > SIZE / 1024


def test_children_are_found_and_those_that_ended_take_nothing() -> None:
    words = [sys.executable, "-c", "print(flush=True); input() # segway_ecc.node.recording.writer"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()  # it is the program by now, and no copy of this process
        assert helpers_of(os.getpid()) == {"recorder": process.pid}
        assert process.pid in children(os.getpid())
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
