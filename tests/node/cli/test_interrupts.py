# SPDX-License-Identifier: MIT
"""Ctrl-C while a command starts is never lost."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.config import read_text
from tests.patience import PATIENCE_S

SWALLOWING = """
import os, signal, time
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(10.0)
except KeyboardInterrupt:
    pass
from segway_ecc.node.models.cart import Cart
"""

IMPORTING = """
import os, signal, sys

class Interrupting:
    def find_spec(self, name, *_):
        if name == "segway_ecc.node.cli.main":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
from segway_ecc.node.cli.entry import main
main()
"""


@pytest.fixture(autouse=True)
def as_at_a_terminal() -> Iterator[None]:
    """A shell that runs us in the background has us ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_while_it_starts_a_command_ends_at_once_and_afterwards_as_python_does() -> None:
    with ends_at_once():
        inside = signal.getsignal(signal.SIGINT)

    assert (inside, signal.getsignal(signal.SIGINT)) == (signal.SIG_DFL, signal.default_int_handler)


def test_who_ignores_it_still_does() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with ends_at_once():
        inside = signal.getsignal(signal.SIGINT)

    assert (inside, signal.getsignal(signal.SIGINT)) == (signal.SIG_IGN, signal.SIG_IGN)


def test_a_robot_whose_start_swallows_the_exception_does_not_run_on(tmp_path: Path) -> None:
    (tmp_path / "swallowing.py").write_text(SWALLOWING)
    robot = tmp_path / "robot.yaml"
    robot.write_text(read_text("cart").replace("segway_ecc.node.models.cart:Cart", "swallowing:Cart"))
    words = ["run", str(robot), "--no-ros", "--no-log", "--duration", "0.1"]
    done = subprocess.run(
        [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words],
        env={**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"},
        capture_output=True,
        timeout=PATIENCE_S,
        check=False,
    )

    assert (done.returncode, done.stdout) == (-signal.SIGINT, b"")


def test_a_command_that_is_still_being_imported_ends_without_a_traceback() -> None:
    done = subprocess.run([sys.executable, "-c", IMPORTING], capture_output=True, timeout=PATIENCE_S, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, b"", b"")


AT_OUR_FIRST_IMPORT = """
import os, runpy, signal, sys
for name in ("typing", "enum", "signal", "contextlib", "importlib", "argparse"):
    sys.modules.pop(name, None)  # as in an interpreter that has just started
is_ours = False

def interrupt(event, details):
    global is_ours
    if event == "import" and details[0].startswith("segway_ecc"):
        is_ours = True
    elif event == "import" and is_ours and details[0] != "_signal":
        os.kill(os.getpid(), 2)

sys.addaudithook(interrupt)
"""


@pytest.mark.parametrize(
    "start",
    [
        "from segway_ecc.node.cli.entry import main; main()",
        "runpy.run_module('segway_ecc.node.cli.main', run_name='__main__')",
    ],
    ids=["command", "module"],
)
def test_nothing_is_imported_before_ctrl_c_ends_the_process(start: str) -> None:
    words = [sys.executable, "-c", f"{AT_OUR_FIRST_IMPORT}\n{start}"]
    done = subprocess.run(words, capture_output=True, timeout=PATIENCE_S, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, b"", b"")
