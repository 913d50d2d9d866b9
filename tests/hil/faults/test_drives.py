# SPDX-License-Identifier: MIT
"""Drives that fail by themselves: once for each fault, at its time; of every family of ours."""

import pytest

from segway_ecc.hil.devices.family import simulated_drives
from segway_ecc.hil.errors import NoSimulationError
from segway_ecc.hil.faults.drives import FailingDrives
from segway_ecc.hil.faults.fault import Fault, Injections
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.node.config import load_robot

MS = 1_000_000


class Clock:
    now_ns = 0

    def __call__(self) -> int:
        return self.now_ns


def failing_at(*times_s: float) -> tuple[Clock, Injections, FailingDrives, list[str]]:
    """Drives that note when they fail; the robot is armed."""
    clock, failed = Clock(), list[str]()
    injections = Injections([Fault(target="drive", type="off", at_s=at_s) for at_s in times_s], 0, clock)
    drives = FailingDrives("wheels", lambda drives: failed.append(f"{drives} at {clock.now_ns // MS}"), injections)
    injections.timeline.start()
    return clock, injections, drives, failed


def run(clock: Clock, drives: FailingDrives, to_ms: int) -> None:
    while clock.now_ns < to_ms * MS:
        clock.now_ns += MS
        drives.act()


def test_they_fail_once_for_each_fault_at_its_time() -> None:
    clock, _, drives, failed = failing_at(0.01, 0.02)
    run(clock, drives, 50)
    assert failed == ["wheels at 10", "wheels at 20"]


def test_a_fault_that_is_declared_later_counts() -> None:
    clock, injections, drives, failed = failing_at()
    run(clock, drives, 10)
    injections.declare([Fault(target="drive", type="off", at_s=0.015)], 0)
    run(clock, drives, 30)
    assert failed == ["wheels at 15"]


def test_drives_that_cannot_are_named_and_only_where_they_have_to() -> None:
    clock, injections, _, _ = failing_at(0.01)
    drives = FailingDrives("wheels", None, injections)
    run(clock, drives, 9)
    with pytest.raises(NoSimulationError, match="cannot fail"):
        run(clock, drives, 10)


@pytest.mark.parametrize("name", ["can", "cia402", "hoverboard", "moteus", "odrive", "vesc"])
def test_the_drives_of_our_families_can(name: str) -> None:
    assert simulated_drives(hardware_of(load_robot(f"cart-{name}"))).fail is not None
