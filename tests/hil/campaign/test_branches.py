# SPDX-License-Identifier: MIT
"""Runs that branch off one trunk, each in a process of its own."""

import os
from collections.abc import Callable

import pytest

from segway_ecc.hil.campaign.branches import BEFORE_NS, Branch, Branches
from segway_ecc.hil.errors import RigError
from segway_ecc.hil.faults.fault import Fault, Injections, Target, Type
from segway_ecc.hil.rig.simulation import LockstepRig

MS = 1_000_000
ARMED_NS = 100 * MS


def fault(target: Target, kind: Type, at_s: float = 0.5, **more: float) -> Fault:
    return Fault(target=target, type=kind, at_s=at_s, **more)  # type: ignore[arg-type]


CUT = fault("can", "off")


class Trunk:
    """A robot that is armed after a while, and sees whether its bus is cut at the end of each 10 ms."""

    def __init__(self, *branches: Branch, is_armed: bool = True) -> None:
        self.rig = LockstepRig(500_000)
        self.injections = Injections((), 0, self.rig.now_ns)
        self.cuts = self.injections.of("can")
        self.branches: Branches[tuple[int, int]] = Branches(self.injections, branches)
        self.rig.add(self.branches)
        self.is_armed = is_armed
        self.seen: list[int] = []

    def simulate(self) -> None:
        for now_ns in range(0, 1000 * MS, 10 * MS):
            self.rig.sleep_until_ns(now_ns)
            if self.is_armed and now_ns >= ARMED_NS:
                self.injections.timeline.start()
            if any(injection.is_active for injection in self.cuts):
                self.seen.append(now_ns)

    def run(self, observe: Callable[[int], tuple[int, int]] | None = None) -> dict[int, tuple[int, int]]:
        return self.branches.run(self.simulate, observe or (lambda place: (place, self.seen[0] // MS)))


def test_each_branch_has_its_own_faults_from_their_time_on() -> None:
    trunk = Trunk(Branch([fault("can", "off", 0.7)], 0), Branch([CUT], 0), Branch([CUT], 0))
    assert trunk.run() == {0: (0, 800), 1: (1, 600), 2: (2, 600)}
    assert trunk.seen == []
    assert trunk.rig.now_ns() == ARMED_NS + 700 * MS - BEFORE_NS  # where nothing is left, it ends


def test_a_branch_is_a_process_of_its_own() -> None:
    trunk = Trunk(Branch([CUT], 0), Branch([CUT], 0))
    found = trunk.run(lambda _: (os.getpid(), os.getppid()))
    assert len({child for child, _ in found.values()} | {os.getpid()}) == 3
    assert {parent for _, parent in found.values()} == {os.getpid()}


def test_a_robot_that_is_never_armed_has_no_branches() -> None:
    assert Trunk(Branch([CUT], 0), is_armed=False).run() == {}


def test_a_branch_that_fails_is_an_error_of_the_trunk(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RigError, match="ended its process with 70"):
        Trunk(Branch([CUT], 0)).run(lambda _: (1 // 0, 0))
    assert "ZeroDivisionError" in capfd.readouterr().err


def test_what_fails_before_it_branches_is_raised_as_it_is() -> None:
    def fail() -> None:
        raise RigError("no such thing")

    with pytest.raises(RigError, match="no such thing"):
        Trunk(Branch([CUT], 0)).branches.run(fail, lambda _: (0, 0))


def test_a_run_branches_off_shortly_before_its_first_fault_with_the_offset_of_its_seed() -> None:
    faults = [fault("can", "off", 0.7), fault("imu", "off", 0.4)]
    assert Branch(faults, 0).begins_ns == 400 * MS - BEFORE_NS
    later_ns = Branch(faults, 3).begins_ns
    assert later_ns is not None
    assert 0 < later_ns - 400 * MS + BEFORE_NS <= 20 * MS


@pytest.mark.parametrize(
    "faults",
    [
        [],
        [fault("can", "off", 0.05)],
        [CUT, Fault(target="imu", type="garbage", at_s=0.5, since="power_on")],
        [CUT, fault("imu", "delayed")],
        [fault("left_motor", "delayed")],
        [fault("can", "wrong")],
        [fault("stranger", "off")],
        [fault("model", "slow")],
        [fault("odometry", "wrong")],
    ],
)
def test_a_run_that_is_another_one_before_its_faults_begin_has_no_branch(faults: list[Fault]) -> None:
    branch = Branch(faults, 0)
    assert branch.begins_ns is None
    with pytest.raises(ValueError, match="no branch"):
        Branches[int](Injections((), 0, lambda: 0), [Branch([CUT], 0), branch])
