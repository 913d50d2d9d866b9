# SPDX-License-Identifier: MIT
"""The witness: a process that is stopped for a moment stands for a machine that stalls."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from segway_ecc.hil import witness as witness_module
from segway_ecc.hil.witness import CROWDED_S, IDLE_S, STALL_S, Gaps, Stalls, Watched, witness
from tests.patience import PATIENCE_S

STOPPED_S = 0.3


def accounted(proc: Path, waited_ms: float = 0.0, slices: int = 1, state: str = "R", process: int = 7) -> None:
    """What the kernel says of a process, whose name may hold anything."""
    (proc / str(process)).mkdir(exist_ok=True)
    (proc / str(process) / "schedstat").write_text(f"123456 {round(waited_ms * 1e6)} {slices}\n", "ascii")
    (proc / str(process) / "stat").write_text(f"{process} (a) S) {state} 1 7 7 0\n", "ascii")


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
        until_s, found = time.monotonic() + PATIENCE_S, Stalls()
        while found.longest_s < STOPPED_S / 2 and time.monotonic() < until_s:  # the threads wake, and see it
            found = seen.stalls()
        again = seen.stalls()

    assert found.longest_s >= STOPPED_S / 2
    assert found.text.startswith("the machine stalled for up to ")
    assert again.longest_s < found.longest_s


def test_short_gaps_are_a_stall_where_there_are_many_of_them() -> None:
    gaps = Gaps()
    for number in range(48):
        gaps.add(number * 0.0625, 0.015625, 0.002)

    assert gaps.longest_s == 0.002
    assert gaps.in_a_second_s == pytest.approx(0.25)
    assert Stalls(gaps.longest_s, gaps.in_a_second_s).text == "the machine stalled for 250 ms of a second"
    gaps.clear()
    gaps.add(4.5, 0.001, 0.001)
    assert gaps.in_a_second_s == pytest.approx(0.001)


def test_few_gaps_each_shorter_than_the_shortest_watchdog_are_no_stall() -> None:
    assert not Stalls(0.9 * STALL_S, 0.9 * CROWDED_S).text
    assert Stalls(STALL_S, 0.0).text == "the machine stalled for up to 20 ms"


def test_a_process_that_waits_for_a_processor_is_seen_in_the_kernels_accounts(tmp_path: Path) -> None:
    accounted(tmp_path, 1000.0)
    watched = Watched(7, tmp_path)
    watched.look(0.005, 0.005)
    assert watched.gaps.longest_s <= 0.0  # what was before it was watched does not count
    accounted(tmp_path, 1004.0, 2)
    watched.look(0.010, 0.005)
    assert watched.gaps.longest_s <= 0.0  # may have been many short waits
    accounted(tmp_path, 1044.0, 3)
    watched.look(0.015, 0.005)
    assert watched.gaps.longest_s == pytest.approx(0.035)
    assert watched.gaps.in_a_second_s == pytest.approx(0.044)


@pytest.mark.parametrize(("state", "idle_s"), [("T", 0.3), ("S", 0.3), ("R", 0.0), ("D", 0.0)])
def test_a_process_that_does_nothing_is_idle_unless_it_waits_for_a_processor_or_a_disk(
    tmp_path: Path, state: str, idle_s: float
) -> None:
    accounted(tmp_path, state=state)
    watched = Watched(7, tmp_path)
    for number in range(60):
        watched.look(number * 0.005, 0.005)
    watched.look(1.0, 0.6)  # in which the machine stalled

    assert watched.longest_idle_s == pytest.approx(idle_s + (STALL_S if idle_s else 0.0))


def test_a_process_that_runs_now_and_then_is_not_idle(tmp_path: Path) -> None:
    accounted(tmp_path, slices=0, state="S")
    watched = Watched(7, tmp_path)
    for number in range(60):
        accounted(tmp_path, slices=1 + number // 2, state="S")
        watched.look(number * 0.005, 0.005)

    assert watched.longest_idle_s == pytest.approx(0.005)


def test_a_process_that_has_ended_or_has_no_account_waits_no_longer(tmp_path: Path) -> None:
    never = Watched(8, tmp_path)
    never.look(0.005, 0.005)
    accounted(tmp_path, 0.0)
    ended = Watched(7, tmp_path)
    (tmp_path / "7" / "schedstat").write_text("no account\n", "ascii")
    ended.look(0.005, 0.005)

    for each in (never, ended):
        assert each.gaps.longest_s <= 0.0
        assert each.gaps.in_a_second_s == 0.0


def test_the_witness_tells_a_process_that_was_stopped_from_a_machine_that_stalled(tmp_path: Path) -> None:
    words = [sys.executable, "-c", "import time\nwhile True: time.sleep(0.001)"]
    with subprocess.Popen(words) as loop, witness(tmp_path / "messages.txt") as seen:
        seen.watch(loop.pid, os.getpid())
        loop.send_signal(signal.SIGSTOP)
        until_s, stopped_s = time.monotonic() + PATIENCE_S, 0.0
        while stopped_s < IDLE_S and time.monotonic() < until_s:
            time.sleep(IDLE_S)
            stopped_s = max(stopped_s, seen.stalls().idle_s[0])
        loop.kill()

    assert stopped_s >= IDLE_S
