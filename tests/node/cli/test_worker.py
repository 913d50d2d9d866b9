# SPDX-License-Identifier: MIT
"""Work that hangs ends all the same: by signals and with who asked for it."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from segway_ecc.node.cli import worker as worker_module
from segway_ecc.node.cli.worker import Worker, run_in_worker
from segway_ecc.node.errors import NodeError, RobotLostError
from tests.patience import PATIENCE_S

HANGING = """
import ctypes, sys
from segway_ecc.node.cli import worker
from segway_ecc.node.errors import AbandonedError
worker._ENDS_S = ENDS_S
def work(one):
    open(sys.argv[1], "w").write(str(__import__("os").getpid()))
    HANG
try:
    worker.run_in_worker(work)
except AbandonedError as error:
    print(error)
"""
LOCK_TWICE = "mutex = ctypes.create_string_buffer(64); [ctypes.KIND(None).pthread_mutex_lock(mutex) for _ in range(2)]"
HANGS = {"with the lock": LOCK_TWICE.replace("KIND", "PyDLL"), "without": LOCK_TWICE.replace("KIND", "CDLL")}
"""Signals end neither; with the interpreter's lock no other thread runs."""


def wait_for(path: Path) -> int:
    """The process id in a file, once it is there."""
    while not (path.exists() and path.read_text()):
        time.sleep(0.01)
    return int(path.read_text())


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def hanging(tmp_path: Path, hang: str, ends_s: float) -> "tuple[subprocess.Popen[str], int]":
    code = HANGING.replace("HANG\n", f"{hang}\n").replace("ENDS_S\n", f"{ends_s}\n")
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "pid")], stdout=subprocess.PIPE, text=True, stdin=subprocess.DEVNULL
    )
    return process, wait_for(tmp_path / "pid")


def test_what_the_work_finds_is_returned() -> None:
    assert run_in_worker(lambda worker: worker.finish({"x": [1.5, None]})) == {"x": [1.5, None]}


def test_an_error_of_the_work_keeps_its_text_and_its_exit_code() -> None:
    def fail(_worker: Worker) -> None:
        raise RobotLostError("it has gone")

    with pytest.raises(NodeError, match=r"^it has gone$") as raised:
        run_in_worker(fail)
    assert raised.value.exit_code == RobotLostError.exit_code


def test_work_that_hangs_after_its_result_keeps_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_module, "_LEAVES_S", 0.2)

    def leave_badly(worker: Worker) -> None:
        worker.finish("done")
        threading.Event().wait()

    assert run_in_worker(leave_badly) == "done"


def test_work_that_ends_without_a_result_is_an_error(capfd: pytest.CaptureFixture[str]) -> None:
    def fail(_worker: Worker) -> None:
        os._exit(3)

    with pytest.raises(NodeError, match="has ended unexpectedly"):
        run_in_worker(fail)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("hang", HANGS.values(), ids=HANGS)
def test_a_signal_ends_work_that_hangs(tmp_path: Path, hang: str) -> None:
    process, pid = hanging(tmp_path, hang, 0.3)
    process.send_signal(signal.SIGTERM)
    text, _ = process.communicate(timeout=PATIENCE_S)
    assert text.startswith("abandoned by SIGTERM before ROS had let go")
    assert not is_running(pid)


def test_a_second_signal_ends_it_at_once(tmp_path: Path) -> None:
    process, pid = hanging(tmp_path, HANGS["with the lock"], 1e6)
    for number in (signal.SIGINT, signal.SIGTERM):  # two of one kind may arrive as one
        process.send_signal(number)
    text, _ = process.communicate(timeout=PATIENCE_S)
    assert text.startswith("abandoned by ")
    assert not is_running(pid)


def test_who_asked_for_it_takes_it_along(tmp_path: Path) -> None:
    process, pid = hanging(tmp_path, HANGS["with the lock"], 1e6)
    process.kill()
    process.communicate(timeout=PATIENCE_S)
    deadline_s = time.monotonic() + PATIENCE_S
    while is_running(pid):
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
