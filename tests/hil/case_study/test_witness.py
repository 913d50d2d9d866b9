# SPDX-License-Identifier: MIT
"""The witness: a process that is stopped for a moment stands for a machine that stalls."""

import os
import signal
import time
from pathlib import Path

import pytest

from segway_ecc.hil.case_study import witness as witness_module
from segway_ecc.hil.case_study.witness import Waits, witness
from tests.patience import PATIENCE_S

STOPPED_S = 0.3


def counted(proc: Path, process: int, waited_ms: float) -> None:
    """The kernel's account of a process: ran, waited (ns), and how often it ran."""
    (proc / str(process)).mkdir(exist_ok=True)
    (proc / str(process) / "schedstat").write_text(f"123456 {round(waited_ms * 1e6)} 78\n", "ascii")


def child_with(words: str) -> int:
    """The child of this process whose command line holds these words."""
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            is_ours = path.read_text("utf-8").rpartition(")")[2].split()[1] == str(os.getpid())
            if is_ours and words in path.with_name("cmdline").read_text("utf-8"):
                return int(path.parent.name)
        except OSError:
            continue
    raise AssertionError(words)


def test_a_stall_is_measured_once(tmp_path: Path) -> None:
    with witness(tmp_path / "messages.txt") as seen:
        process = child_with(witness_module.__name__)
        os.kill(process, signal.SIGSTOP)
        time.sleep(STOPPED_S)
        os.kill(process, signal.SIGCONT)
        until_s, found = time.monotonic() + PATIENCE_S, 0.0
        while found < STOPPED_S / 2 and time.monotonic() < until_s:  # the threads wake, and see it
            found = max(found, seen.longest_stall_s())

    assert found >= STOPPED_S / 2


def test_a_gap_shorter_than_the_shortest_watchdog_is_no_stall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(witness_module, "STALL_S", 1e9)
    with witness(tmp_path / "messages.txt") as seen:
        assert seen.longest_stall_s() == 0.0


def test_a_process_that_waits_for_a_processor_is_seen_in_the_kernels_accounts(tmp_path: Path) -> None:
    counted(tmp_path, 7, 1000.0)
    counted(tmp_path, 8, 5.0)
    waits = Waits(tmp_path)
    waits.add(7)
    waits.add(8)
    assert waits.longest_s(0.005) <= 0.0  # what was before it was watched does not count
    counted(tmp_path, 7, 1004.0)
    assert waits.longest_s(0.005) <= 0.0  # may have been many short waits
    counted(tmp_path, 7, 1008.0)
    counted(tmp_path, 8, 45.0)
    assert waits.longest_s(0.005) == pytest.approx(0.035)
    assert waits.longest_s(0.005) <= 0.0


def test_a_process_that_has_ended_or_has_no_account_waits_no_longer(tmp_path: Path) -> None:
    waits = Waits(tmp_path)
    assert waits.longest_s(0.005) <= 0.0
    waits.add(9)
    assert waits.longest_s(0.005) <= 0.0
    counted(tmp_path, 9, 50.0)
    waits.longest_s(0.005)
    (tmp_path / "9" / "schedstat").write_text("no account\n", "ascii")
    assert waits.longest_s(0.005) <= 0.0


def test_the_witness_reads_the_accounts_of_those_it_watches(tmp_path: Path) -> None:
    with witness(tmp_path / "messages.txt") as seen:
        seen.watch(os.getpid(), os.getppid())
        assert seen.longest_stall_s() >= 0.0
