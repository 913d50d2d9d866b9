# SPDX-License-Identifier: MIT
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.held_up import Witnesses

SPIN = """
import os, time
os.sched_setaffinity(0, {core})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(99))
until = time.monotonic() + 0.05
while time.monotonic() < until:
    pass
"""
CONFTEST = """
from tests import held_up

class Told:
    are_above = {are_above}

    def longest_gap_s(self):
        return {gap_s}

def pytest_configure(config):
    config.pluginmanager.register(held_up)
    config.addinivalue_line("markers", "real_time: as in the project's own")
    config.stash[held_up.WITNESSES] = Told()
"""
TESTS = """
import pathlib
import pytest

def runs(name):
    with pathlib.Path(__file__).with_name(name).open("a") as file:
        file.write("x")
        return file.tell()

@pytest.mark.real_time
def test_once_late():
    assert runs("late") > 1

@pytest.mark.real_time
def test_wrong():
    runs("wrong")
    assert False

@pytest.mark.real_time
def test_right():
    runs("right")

def test_that_waits_for_nobody():
    runs("other")
    assert False
"""


@pytest.mark.parametrize(
    ("are_above", "gap_s", "outcome", "runs"),
    [
        (True, 0.017, "2 failed, 2 passed", {"late": 2, "wrong": 2, "right": 1, "other": 1}),
        (True, 0.0, "3 failed, 1 passed", {"late": 1, "wrong": 1, "right": 1, "other": 1}),
        (False, 0.017, "1 failed, 1 passed, 2 skipped", {"late": 1, "wrong": 1, "right": 1, "other": 1}),
        (False, 0.0, "3 failed, 1 passed", {"late": 1, "wrong": 1, "right": 1, "other": 1}),
    ],
)
def test_only_what_failed_while_the_machine_stood_still_is_run_again_once_or_not_shown(
    tmp_path: Path, *, are_above: bool, gap_s: float, outcome: str, runs: dict[str, int]
) -> None:
    (tmp_path / "conftest.py").write_text(CONFTEST.format(are_above=are_above, gap_s=gap_s), "utf-8")
    (tmp_path / "test_some.py").write_text(TESTS, "utf-8")

    words = [sys.executable, "-P", "-m", "pytest", "-p", "no:cacheprovider", "-c", "/dev/null", f"--rootdir={tmp_path}"]
    done = subprocess.run([*words, str(tmp_path)], capture_output=True, text=True, check=False)

    assert outcome in done.stdout
    assert {name: len((tmp_path / name).read_text("utf-8")) for name in runs} == runs
    assert ("test_once_late: run again: the machine stood still, ms: 17" in done.stdout) is (are_above and gap_s > 0.0)
    not_shown = "test_wrong: not shown: without real-time priority the machine stood still, ms: 17"
    assert (not_shown in done.stdout) is (not are_above and gap_s > 0.0)


@pytest.mark.real_time
def test_a_processor_that_is_taken_is_seen() -> None:
    witnesses = Witnesses()
    try:
        witnesses.longest_gap_s()
        core = min(os.sched_getaffinity(0))
        if subprocess.run([sys.executable, "-c", SPIN.replace("{core}", f"{{{core}}}")], check=False).returncode != 0:
            pytest.skip("needs real-time priority (root, or ulimit -r)")
        deadline = time.monotonic() + 5.0
        while (gap_s := witnesses.longest_gap_s()) < 0.03:
            assert time.monotonic() < deadline, gap_s
            time.sleep(0.01)
    finally:
        witnesses.close()
