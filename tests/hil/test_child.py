# SPDX-License-Identifier: MIT
"""No process outlives the one that started it, even one that is killed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

PARENT = """
import sys, time
from pathlib import Path
from segway_ecc.hil.processes import command
with command(["run", "cart", "--no-ros", "--no-log"], Path(sys.argv[1])) as started:
    print(started.process.pid, flush=True)
    time.sleep(600)
"""
CHILD = [sys.executable, "-P", "-m", "segway_ecc.hil.child"]


def lives(pid: int) -> bool:
    """Whether a process runs or is stopped; one whose new parent has not noticed its end does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def ends(pid: int) -> bool:
    deadline = time.monotonic() + PATIENCE_S
    while lives(pid) and time.monotonic() < deadline:
        time.sleep(0.01)
    return not lives(pid)


def messages_with(path: Path, word: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while word not in (path.read_text() if path.exists() else ""):
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize("is_stopped", [False, True])
def test_a_command_ends_with_a_parent_that_is_killed(tmp_path: Path, *, is_stopped: bool) -> None:
    messages = tmp_path / "messages.txt"
    with subprocess.Popen([sys.executable, "-c", PARENT, str(messages)], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        messages_with(messages, "ARMED")
        if is_stopped:
            os.kill(child, signal.SIGSTOP)
        assert lives(child)
        parent.kill()

    assert ends(child)


def test_a_child_whose_parent_has_ended_before_it_asked_ends_at_once() -> None:
    # Of another parent than it is told, as one that was handed on.
    found = subprocess.run([*CHILD, "1", "segway_ecc.node.cli.main", "--version"], capture_output=True, check=False)

    assert (found.returncode, found.stdout) == (-signal.SIGKILL, b"")


def test_the_module_sees_its_arguments_and_runs_as_main() -> None:
    words = [str(os.getpid()), "segway_ecc.node.cli.main", "run", "no such robot"]
    found = subprocess.run([*CHILD, *words], capture_output=True, check=False, text=True)

    assert found.returncode == 2
    assert found.stderr.startswith("segway-ecc: cannot read robot file 'no such robot'")
