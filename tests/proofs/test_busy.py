# SPDX-License-Identifier: MIT
"""tests/proofs/busy.sh with stand-ins for the case study and for the load: what it counts, and that its load ends."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).with_name("busy.sh")
CELL = {"linear": 1, "angular": 0, "offline_20sim": [1.0, 0.0]}
GOOD = {seat: [1.005, 0.0] for seat in ("offline", "submodel", "ros", "can")}


@pytest.fixture
def tools() -> Iterator[Path]:
    """A folder to put first in PATH; the load sleeps, and the machine gives nobody real-time priority."""
    with tempfile.TemporaryDirectory() as name:  # and not pytest's own, which is closed to the ordinary user
        folder = Path(name)
        folder.chmod(0o755)
        for tool, body in {"stress-ng": 'echo $$ >> "$PIDS"; exec sleep 60', "chrt": "exit 1"}.items():
            put(folder / tool, body)
        yield folder


def put(path: Path, body: str) -> None:
    path.write_text(f"#!/bin/sh\n{body}\n", encoding="utf-8")
    path.chmod(0o755)


def busy(tools: Path, *words: str, **cell: Any) -> subprocess.CompletedProcess[str]:
    found = {"cells": [CELL | cell], "real_time": None, "repeated": ["one"]}
    put(tools / "study", f"cat << END\n{json.dumps(found)}\nEND")
    (tools / "pids").touch()
    (tools / "pids").chmod(0o666)
    path = f"{tools}:{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "SEGWAY_ECC": str(tools / "study"), "PIDS": str(tools / "pids")}
    return subprocess.run([SCRIPT, *words], env=environment, capture_output=True, text=True, check=False, timeout=60)


def test_shellcheck_finds_nothing() -> None:
    shellcheck = Path(sys.executable).parent / "shellcheck"
    done = subprocess.run([shellcheck, SCRIPT], capture_output=True, text=True, check=False)

    assert (done.returncode, done.stdout) == (0, "")


def test_runs_within_every_limit_succeed_and_the_load_has_ended(tools: Path) -> None:
    done = busy(tools, "2", **GOOD)

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
    done = busy(tools, "1", **GOOD | cell)

    assert done.returncode == 1
    assert "BEYOND A LIMIT" in done.stdout


@pytest.mark.parametrize("words", ["0", "many", "-1"])
def test_a_number_of_runs_that_is_none_is_refused(tools: Path, words: str) -> None:
    done = busy(tools, words)

    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"busy: RUNS is a number, 1 or more, not '{words}'\n"
