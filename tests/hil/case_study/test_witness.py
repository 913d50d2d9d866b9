# SPDX-License-Identifier: MIT
"""The witness: a process that is stopped for a moment stands for a machine that stalls."""

import os
import signal
import time
from pathlib import Path

import pytest

from segway_ecc.hil.case_study import witness as witness_module
from segway_ecc.hil.case_study.witness import witness

STOPPED_S = 0.3


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
    with witness(tmp_path / "messages.txt") as longest_stall_s:
        process = child_with(witness_module.__name__)
        os.kill(process, signal.SIGSTOP)
        time.sleep(STOPPED_S)
        os.kill(process, signal.SIGCONT)
        time.sleep(0.1)  # the threads wake and see it
        found = longest_stall_s()

    assert found >= STOPPED_S / 2


def test_a_gap_shorter_than_the_shortest_watchdog_is_no_stall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(witness_module, "STALL_S", 1e9)
    with witness(tmp_path / "messages.txt") as longest_stall_s:
        assert longest_stall_s() == 0.0
