# SPDX-License-Identifier: MIT
"""tests/proofs/busy.sh with stand-ins for the case study and for the load: what it counts, and that its load ends."""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).with_name("busy.sh")
CELL = {"linear": 1, "angular": 0, "offline_20sim": [1.0, 0.0]}
MAKE = """case $* in *.venv/.ready) exit 0 ;; esac
test -w pyproject.toml -a "$*" = test || exit 3
echo "$(id -u) $USER $HOME" >> "$PIDS.tests"
echo "FAILED tests/test_one.py::test_late - TimeoutError"
[ "$(wc -l < "$PIDS.tests")" -ne 2 ]"""
"""Sets up at once; the second test run fails."""
GOOD = {seat: [1.005, 0.0] for seat in ("offline", "submodel", "ros", "can")}


@pytest.fixture
def tools() -> Iterator[Path]:
    """A folder to put first in PATH; the load sleeps, and the machine gives nobody real-time priority."""
    with tempfile.TemporaryDirectory() as name:  # and not pytest's own, which is closed to the ordinary user
        folder = Path(name)
        folder.chmod(0o755)
        for tool, body in {"stress-ng": 'echo $$ >> "$PIDS"; exec sleep 60', "chrt": "exit 1", "make": MAKE}.items():
            put(folder / tool, body)
        yield folder


def put(path: Path, body: str) -> None:
    path.write_text(f"#!/bin/sh\n{body}\n", encoding="utf-8")
    path.chmod(0o755)


def prepared(tools: Path, factor: Any = 1000, lasts_s: Any = 0.0, **cell: Any) -> dict[str, str]:
    """The environment of a script whose study takes so long and finds such a cell."""
    found = {"cells": [CELL | cell], "real_time": None, "repeated": ["one"]}
    put(tools / "study", f"sleep {lasts_s}\ncat << END\n{json.dumps(found)}\nEND")
    for name in ("pids", "pids.tests"):
        (tools / name).touch()
        (tools / name).chmod(0o666)
    path = f"{tools}:{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "SEGWAY_ECC": str(tools / "study"), "PIDS": str(tools / "pids")}
    environment["FACTOR"] = str(factor)
    return environment


def busy(tools: Path, *words: str, **found: Any) -> subprocess.CompletedProcess[str]:
    environment = prepared(tools, **found)
    return subprocess.run([SCRIPT, *words], env=environment, capture_output=True, text=True, check=False, timeout=60)


def test_shellcheck_finds_nothing() -> None:
    shellcheck = Path(sys.executable).parent / "shellcheck"
    done = subprocess.run([shellcheck, SCRIPT], capture_output=True, text=True, check=False)

    assert (done.returncode, done.stdout) == (0, "")


def test_runs_within_every_limit_succeed_and_the_load_has_ended(tools: Path) -> None:
    done = busy(tools, "2", "0", **GOOD)

    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 of 2 succeeded" in done.stdout
    assert (
        "offline 0.0050 m, submodel 0.0050 m, ros 0.0050 m, can 0.0050 m, bits of ros and offline equal, 1 repeats"
        in (done.stdout)
    )
    pids = (tools / "pids").read_text("utf-8").split()
    assert pids
    assert not [pid for pid in pids if Path(f"/proc/{pid}").exists()]


@pytest.mark.parametrize("cell", [{"ros": [1.005, 2**-50]}, {"can": [1.13, 0.0]}, {"offline": [1.007, 0.0]}])
def test_a_cell_beyond_its_limit_and_bits_that_differ_fail(tools: Path, cell: dict[str, Any]) -> None:
    done = busy(tools, "1", "0", **GOOD | cell)

    assert done.returncode == 1
    assert "BEYOND A LIMIT" in done.stdout


def test_a_run_that_takes_longer_than_the_load_explains_fails(tools: Path) -> None:
    done = busy(tools, "1", "0", factor=0, lasts_s=1.1, **GOOD)

    assert done.returncode == 1
    assert "TOO SLOW, more than 0 s: offline 0.0050 m" in done.stdout
    assert "0 of 1 succeeded" in done.stdout


def test_the_test_run_is_counted_and_its_failures_are_named(tools: Path) -> None:
    done = busy(tools, "1", "3", **GOOD)

    assert done.returncode == 1, done.stdout + done.stderr
    assert "1 of 1 succeeded" in done.stdout
    assert re.search("test run 2: [0-9]+ s, FAILED with exit code 1: FAILED tests/test_one.py::test_late", done.stdout)
    assert "2 of 3 test runs succeeded" in done.stdout
    users = {line.split()[0] for line in (tools / "pids.tests").read_text("utf-8").splitlines()}
    assert users == {str(os.geteuid() or 65534)}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_tests_end_with_the_script(tools: Path, number: signal.Signals) -> None:
    put(tools / "make", """case $* in *.venv/.ready) exit 0 ;; esac\necho $$ >> "$PIDS.tests"\nexec sleep 60""")
    environment = prepared(tools, **GOOD)
    with subprocess.Popen([SCRIPT, "1", "1"], env=environment, stdout=subprocess.PIPE) as script:
        while not (pids := (tools / "pids.tests").read_text("utf-8").split()):
            time.sleep(0.01)
        script.send_signal(number)
        assert script.wait() == 128 + number
    assert not [pid for pid in pids if Path(f"/proc/{pid}").exists()]


@pytest.mark.parametrize("words", ["0", "many", "-1"])
def test_a_number_of_runs_that_is_none_is_refused(tools: Path, words: str) -> None:
    done = busy(tools, words)

    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"busy: RUNS is a number, 1 or more, not '{words}'\n"
    assert busy(tools, "1", "many").stderr == "busy: TEST_RUNS is a number, 0 or more, not 'many'\n"
