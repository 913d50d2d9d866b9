# SPDX-License-Identifier: MIT
import ctypes
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from segway_ecc.node.cycle import real_time
from segway_ecc.node.cycle.real_time import (
    SWITCH_INTERVAL_S,
    helping_threads,
    isolated_processors,
    real_time_loop,
    real_time_priority,
)
from tests.open_files import open_files

PR_GET_TIMERSLACK = 30
"""Of linux/prctl.h."""

LOCK = """
import resource
from segway_ecc.node.cycle.real_time import lock_memory
hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
resource.setrlimit(resource.RLIMIT_MEMLOCK, (1 << 16, hard))
def refuse(*_):
    raise ValueError("not allowed to raise maximum limit")
resource.setrlimit = refuse
print(lock_memory())
held = bytearray(8 << 20)
held[::4096] = b"x" * (len(held) // 4096)
print(next(line for line in open("/proc/self/status") if line.startswith("VmLck")).split()[1])
"""

REAL_TIME = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int, int]]:
    """What the kernel was asked for, granted."""
    asked: list[tuple[int, int, int]] = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda pid, policy, p: asked.append((pid, policy, p.sched_priority)))
    return asked


def test_what_is_granted_is_asked_for_this_thread_alone_and_given_back(asked: list[tuple[int, int, int]]) -> None:
    before = (0, os.sched_getscheduler(0) | os.SCHED_RESET_ON_FORK, os.sched_getparam(0).sched_priority)
    with real_time_priority(42) as refusal:
        assert refusal is None
        assert asked == [(0, REAL_TIME, 42)]
    assert asked == [(0, REAL_TIME, 42), before]


def test_it_is_given_back_after_a_failure_too(asked: list[tuple[int, int, int]]) -> None:
    def fail() -> None:
        with real_time_priority():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert len(asked) == 2


def test_missing_permission_is_reported_with_its_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with real_time_priority() as refusal:
        assert refusal == (
            "no real-time priority (Operation not permitted): other programs can make cycles late; "
            "run as root, or raise the limit: ulimit -r"
        )


@pytest.mark.parametrize("policy", [os.SCHED_FIFO, os.SCHED_RR, REAL_TIME])
def test_what_a_service_was_given_is_kept(
    asked: list[tuple[int, int, int]], monkeypatch: pytest.MonkeyPatch, policy: int
) -> None:
    monkeypatch.setattr(os, "sched_getscheduler", lambda _: policy)
    with real_time_priority(42) as refusal:
        assert refusal is None
    assert asked == []


@pytest.fixture
def idle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What stands for the kernel's file."""
    path = tmp_path / "cpu_dma_latency"
    path.touch()
    monkeypatch.setattr(real_time, "IDLE_LATENCY", path)
    return path


@pytest.fixture
def isolated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Which processors were set aside."""
    path = tmp_path / "isolated"
    path.write_text("\n")
    monkeypatch.setattr(real_time, "ISOLATED", path)
    return path


@pytest.fixture
def pinned(monkeypatch: pytest.MonkeyPatch) -> list[set[int]]:
    """Where this thread was put, on a machine of four processors."""
    pinned = [{0, 1, 2, 3}]
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: pinned[-1])
    monkeypatch.setattr(os, "sched_setaffinity", lambda _, processors: pinned.append(set(processors)))
    return pinned


def slack_ns() -> int:
    return int(ctypes.CDLL(None).prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0))


@pytest.mark.usefixtures("asked", "isolated")
def test_all_is_asked_for_and_all_is_given_back(idle: Path) -> None:
    before = slack_ns(), sys.getswitchinterval()
    with real_time_loop(lock=False) as lacking:
        assert lacking == ()
        assert (slack_ns(), sys.getswitchinterval()) == (1, SWITCH_INTERVAL_S)
        assert idle.read_bytes() == bytes(4)
        assert str(idle) in open_files(), "the kernel keeps to it for as long as the file is open"
    assert (slack_ns(), sys.getswitchinterval()) == before
    assert str(idle) not in open_files()


@pytest.mark.usefixtures("asked", "isolated")
def test_deep_idle_is_reported_with_the_remedy(idle: Path) -> None:
    idle.unlink()
    with real_time_loop(lock=False) as lacking:
        assert lacking == (
            (
                f"processors may sleep deeply between cycles ({idle}: No such file or directory): each begins slowly; "
                "run as root, or let the robot's group write to that file"
            ),
        )


@pytest.mark.usefixtures("asked", "idle")
def test_processors_that_were_set_aside_are_used_and_left_again(isolated: Path, pinned: list[set[int]]) -> None:
    isolated.write_text("2-3\n")
    with real_time_loop(lock=False) as lacking:
        assert (lacking, pinned[-1]) == ((), {2, 3})
    assert pinned[-1] == {0, 1, 2, 3}


@pytest.mark.usefixtures("asked", "idle")
def test_a_service_that_was_put_on_one_of_them_stays_there(isolated: Path, pinned: list[set[int]]) -> None:
    isolated.write_text("2-3\n")
    pinned.append({3})
    with real_time_loop(lock=False):
        assert pinned[-1] == {3}


@pytest.mark.usefixtures("asked", "idle", "pinned")
def test_unusable_isolated_processors_are_reported(isolated: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(22, "Invalid argument")

    isolated.write_text("1\n")
    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    with real_time_loop(lock=False) as lacking:
        assert lacking == (
            "not on the isolated processors [1] (Invalid argument): other programs can make cycles late",
        )


@pytest.mark.parametrize(
    ("text", "expected"), [("", set()), ("3", {3}), ("1,3-5", {1, 3, 4, 5})], ids=["none", "one", "several"]
)
def test_the_kernels_list_of_processors(isolated: Path, text: str, expected: set[int]) -> None:
    isolated.write_text(f"{text}\n")
    assert isolated_processors() == expected


def test_a_kernel_without_the_list_has_set_none_aside(isolated: Path) -> None:
    isolated.unlink()
    assert isolated_processors() == set()


def test_memory_of_limited_amount_is_not_locked() -> None:
    """That it is locked without a limit is seen in the image's boot test."""
    done = subprocess.run([sys.executable, "-I", "-c", LOCK], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        (
            "memory is not locked (its amount is limited): where it runs short, cycles wait for the disk; "
            "ulimit -l unlimited"
        ),
        "0",
    ]


def helped() -> int | None:
    """The number of a thread that began among the helping ones, and has ended."""
    over = threading.Event()
    with helping_threads():
        thread = threading.Thread(target=over.wait)
        thread.start()
    over.set()
    thread.join()
    return thread.native_id


def test_threads_that_begin_inside_get_a_priority_below_the_loops(asked: list[tuple[int, int, int]]) -> None:
    thread = helped()
    assert asked == [(thread, os.SCHED_FIFO, 45)]


def test_where_that_is_not_permitted_they_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    helped()
