# SPDX-License-Identifier: MIT
"""When a fault is there: counted from arming, for as long as declared, shifted by the seed."""

import pytest

from segway_ecc.hil.faults.fault import Fault, Injections

MS = 1_000_000


class Clock:
    def __init__(self) -> None:
        self.ns = 5_000 * MS

    def now_ns(self) -> int:
        return self.ns


def injections(clock: Clock, seed: int = 0, for_s: float | None = None) -> Injections:
    return Injections([Fault(target="can", type="intermittent", at_s=0.1, for_s=for_s)], seed, clock.now_ns)


def test_nothing_fails_before_the_robot_is_armed() -> None:
    clock = Clock()
    (injection,) = injections(clock).of("can")
    clock.ns += 1_000 * MS
    assert not injection.is_active


@pytest.mark.parametrize(
    ("after_ms", "is_active"), [(0, False), (99, False), (100, True), (299, True), (300, False), (301, False)]
)
def test_a_fault_is_active_from_its_time_on_for_its_duration(after_ms: int, *, is_active: bool) -> None:
    clock = Clock()
    faults = injections(clock, for_s=0.2)
    faults.timeline.start()
    clock.ns += after_ms * MS
    faults.timeline.start()  # armed again: the time goes on
    (injection,) = faults.of("can")
    assert injection.is_active is is_active


def test_a_fault_for_good_stays() -> None:
    clock = Clock()
    faults = injections(clock)
    faults.timeline.start()
    clock.ns += 3_600_000 * MS
    assert faults.of("can")[0].is_active


def test_seed_zero_is_exact_and_every_other_up_to_20_ms_later() -> None:
    firsts = [injections(Clock(), seed).first_ns or 0 for seed in range(50)]
    assert firsts[0] == 100 * MS
    assert all(100 * MS < first <= 120 * MS for first in firsts[1:])
    assert len(set(firsts)) == 50


def test_chance_is_the_seeds() -> None:
    rolls = [[injections(Clock(), seed).of("can")[0].happens() for _ in range(3)] for seed in (1, 1)]
    assert rolls[0] == rolls[1]
    one, same, other = (injections(Clock(), seed).of("can")[0] for seed in (1, 1, 2))
    assert [[i.happens() for _ in range(64)] for i in (one, same)].count([other.happens() for _ in range(64)]) == 0


def test_only_faults_of_the_part_are_given() -> None:
    assert injections(Clock()).of("serial", "imu") == []


def test_a_fault_comes_again_as_often_as_declared() -> None:
    clock = Clock()
    faults = Injections([Fault(target="can", type="off", at_s=0.1, for_s=0.02, every_s=0.05)], 0, clock.now_ns)
    faults.timeline.start()
    (injection,) = faults.of("can")
    active = []
    for ms in range(250):
        active += [ms] if injection.is_active else []
        clock.ns += MS
    assert active == [*range(100, 120), *range(150, 170), *range(200, 220)]


def test_a_fault_since_power_on_does_not_wait_for_the_robot_to_be_armed() -> None:
    clock = Clock()
    fault = Fault(target="imu", type="off", at_s=0.1, for_s=0.1, since="power_on")
    faults = Injections([fault], 0, clock.now_ns)
    (injection,) = faults.of("imu")
    active = []
    for ms in range(250):
        active += [ms] if injection.is_active else []
        clock.ns += MS
        if ms == 150:
            faults.timeline.start()
    assert active == [*range(100, 200)]
    assert faults.first_ns == 0


def test_faults_that_are_declared_later_join_those_that_were_handed_out() -> None:
    clock = Clock()
    given = Fault(target="can", type="off", at_s=0.1)
    late = Injections([], 0, clock.now_ns)
    of_can, of_imu = late.of("can"), late.of("imu", "battery")
    late.declare([given, Fault(target="imu", type="off", at_s=0.2)], 7)
    assert [injection.fault for injection in of_can] == [given]
    assert [injection.fault.target for injection in of_imu] == ["imu"]
    at_once = Injections([given], 7, clock.now_ns)
    assert late.first_ns == at_once.first_ns
    assert of_can[0].random.random() == at_once.of("can")[0].random.random()
