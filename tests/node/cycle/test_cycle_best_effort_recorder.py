# SPDX-License-Identifier: MIT
"""A recorder that fails, in whatever it is called for, neither ends nor stops the robot."""

import logging
from collections import deque
from collections.abc import Callable, Sequence

import pytest

from segway_ecc.node.cycle.cycle import BestEffortRecorder
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.safety.modes import Mode
from segway_ecc.testing import Bench


class Disk:
    """A recorder that raises in some of its methods, and counts the calls."""

    def __init__(self, fails: Sequence[str], error: Exception) -> None:
        self.fails = fails
        self.error = error
        self.calls: list[str] = []

    def write(self, record: CycleRecord) -> None:
        del record
        self.call("write")

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        del stamp_ns, statuses
        self.call("write_diagnostics")

    def write_state(self, take: Callable[[], Snapshot]) -> None:
        del take
        self.call("write_state")

    def close(self) -> None:
        self.call("close")

    def call(self, method: str) -> None:
        self.calls.append(method)
        if method in self.fails:
            raise self.error


def loop_with(bench: Bench, disk: Disk) -> Loop:
    bench.cycle.recorder = BestEffortRecorder(disk, bench.cycle.events)
    return Loop(
        cycle=bench.cycle,
        clock=bench.clock,
        stage=bench.stage,
        period_ns=bench.period_ns,
        robot_name="bench",
    )


ERRORS = [RecordingError("the disk is full"), OSError("the disk is full"), ValueError("the disk is full")]


@pytest.mark.parametrize("error", ERRORS)
@pytest.mark.parametrize(
    "fails",
    [["write"], ["write_diagnostics"], ["write_state"], ["close"], ["write", "write_diagnostics", "close"]],
)
def test_robot_drives_on_after_recorder_failure_and_logs_it_once(
    make_bench: Callable[..., Bench], caplog: pytest.LogCaptureFixture, error: Exception, fails: list[str]
) -> None:
    bench, disk = make_bench(), Disk(fails, error)
    with caplog.at_level(logging.WARNING):
        loop_with(bench, disk).run(cycles=350)
    assert bench.loop.modes.mode is Mode.ARMED
    assert len(bench.hardware.sent) == 351
    assert bench.journal[-4:] == ["disarm", "final", "close", "stage closed"]
    said = [record.getMessage() for record in caplog.records if "recording" in record.getMessage()]
    assert said == [f"recording has ended: {type(error).__name__}: the disk is full"]


def test_nothing_more_is_given_to_one_that_failed_but_it_is_closed(
    make_bench: Callable[..., Bench], caplog: pytest.LogCaptureFixture
) -> None:
    bench, disk = make_bench(), Disk(["write_diagnostics"], OSError("gone"))
    with caplog.at_level(logging.WARNING):
        loop_with(bench, disk).run(cycles=250)
    writes = disk.calls.count("write")
    assert disk.calls == ["write"] * writes + ["write_state", "write_diagnostics", "close"]
    assert 100 <= writes < 120, "the first diagnostics come after a second"
    lost = f"the log lacks {250 - writes} cycles, from cycle {writes} on: none was handed over"
    assert [line for line in caplog.messages if "lacks" in line] == [lost]


def test_a_cycle_that_it_failed_with_counts_as_missing(
    make_bench: Callable[..., Bench], caplog: pytest.LogCaptureFixture
) -> None:
    bench = make_bench()
    with caplog.at_level(logging.WARNING):
        loop_with(bench, Disk(["write"], OSError("gone"))).run(cycles=20)
    assert "the log lacks 20 cycles, from cycle 0 on: none was handed over" in caplog.messages


def test_one_that_does_not_fail_is_given_everything(make_bench: Callable[..., Bench]) -> None:
    bench, disk = make_bench(), Disk([], OSError("gone"))
    loop_with(bench, disk).run(cycles=250)
    assert [disk.calls.count(call) for call in ("write", "write_diagnostics", "write_state")] == [250, 2, 2]
    assert disk.calls[-1] == "close"


def test_what_ends_the_process_is_not_held_up() -> None:
    disk = Disk(["close"], RuntimeError("never mind"))
    disk.error = KeyboardInterrupt()  # type: ignore[assignment] # not an Exception, which is the point
    with pytest.raises(KeyboardInterrupt):
        BestEffortRecorder(disk, deque()).close()
