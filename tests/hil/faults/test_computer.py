# SPDX-License-Identifier: MIT
"""A wall clock that steps, and a node that stalls or dies; monotonic time is never wrong."""

from collections.abc import Callable

import pytest

from segway_ecc.hil.faults.computer import DisturbedClock, FailingRecorder, ProcessKilledError
from segway_ecc.hil.faults.fault import Fault, Injections, Target, Type
from segway_ecc.hil.rig.simulation import WALL_START_NS, LockstepRig
from segway_ecc.node.cycle.interfaces import CycleRecord, NoRecorder
from segway_ecc.node.cycle.state import Snapshot

MS = 1_000_000


def clock_with(target: Target, kind: Type, amount: float | None = None, for_s: float | None = None) -> DisturbedClock:
    rig = LockstepRig(500_000)
    faults = Injections([Fault(target=target, type=kind, at_s=0.1, amount=amount, for_s=for_s)], 0, rig.now_ns)
    faults.timeline.start()
    return DisturbedClock(rig, faults)


def walls(clock: DisturbedClock) -> list[float]:
    """How much the wall clock is ahead of monotonic time at 0.05, 0.2, 0.3 and 0.5 s, ms."""
    ahead = []
    for ms in (50, 200, 300, 500):
        clock.sleep_until_ns(ms * MS)
        assert clock.now_ns() == ms * MS
        ahead.append((clock.wall_ns() - WALL_START_NS - clock.now_ns()) / MS)
    return ahead


def test_the_wall_clock_steps() -> None:
    assert walls(clock_with("clock", "wrong", -3600, 0.3)) == [0.0, -3_600_000, -3_600_000, 0.0]


def test_the_wall_clock_stands_still() -> None:
    assert walls(clock_with("clock", "stuck")) == [0.0, -100.0, -200.0, -400.0]


def test_the_wall_clock_loses_time() -> None:
    assert walls(clock_with("clock", "slow", 0.01)) == [0.0, -1.0, -2.0, -4.0]


def test_a_node_stalls_once() -> None:
    clock = clock_with("process", "stuck", 0.3)
    woken = []
    for ms in (90, 100, 410, 420):
        clock.sleep_until_ns(ms * MS)
        woken.append(clock.now_ns() // MS)
    assert woken == [90, 400, 410, 420]


def test_every_cycle_is_late() -> None:
    clock = clock_with("process", "slow", 0.003, 0.05)
    woken = []
    for ms in (90, 100, 110, 160):
        clock.sleep_until_ns(ms * MS)
        woken.append(clock.now_ns() // MS)
    assert woken == [90, 103, 113, 160]


def test_a_node_is_killed() -> None:
    clock = clock_with("process", "off")
    killed = []
    clock.on_kill = lambda: killed.append(clock.now_ns())
    clock.sleep_until_ns(99 * MS)
    with pytest.raises(ProcessKilledError):
        clock.sleep_until_ns(100 * MS)
    assert killed == [100 * MS]


def test_snapshots_are_lost_and_cycles_are_not() -> None:
    kept: list[str] = []

    class Keeping(NoRecorder):
        def write(self, record: CycleRecord) -> None:  # noqa: ARG002 - what of it is no matter
            kept.append("cycle")

        def write_state(self, take: Callable[[], Snapshot]) -> None:  # noqa: ARG002 - as above
            kept.append("snapshot")

    rig = LockstepRig(500_000)
    injections = Injections([Fault(target="disk", type="intermittent", at_s=0.1, amount=1.0)], 0, rig.now_ns)
    recorder = FailingRecorder(Keeping(), injections, DisturbedClock(rig, injections))
    injections.timeline.start()
    for ms in (90, 110):
        rig.sleep_until_ns(ms * MS)
        recorder.write(None)  # type: ignore[arg-type]  # nobody looks at it
        recorder.write_state(None)  # type: ignore[arg-type]  # as above
    assert kept == ["cycle", "snapshot", "cycle"]
