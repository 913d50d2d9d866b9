# SPDX-License-Identifier: MIT
"""What the drives themselves say of being off, in lock step: never before they are, and soon after."""

from collections.abc import Callable
from typing import Any

import pytest

from segway_ecc.hil.rig.fronts import FaultyLink, LinkFault
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import load_robot
from segway_ecc.node.robot import build_robot

CYCLE_NS = 10_000_000
CONFIRMED_WITHIN = 6  # cycles: a status every 20 ms of the slowest, and a cycle each way
Truth = Callable[[Any], bool]

FAMILIES: dict[str, Truth] = {
    "cart-can": lambda device: device.state.name == "ENABLED",
    "cart-odrive": lambda device: any(axis.state.name == "CLOSED_LOOP_CONTROL" for axis in device.axes),
    "cart-vesc": lambda device: (
        max(abs(device.controllers["left"].current), abs(device.controllers["right"].current)) > 0.55
    ),
    "cart-cia402": lambda device: device.axes["left"].torque != 0.0 or device.axes["right"].torque != 0.0,
    "cart-moteus": lambda device: any(each.mode == 10 for each in device.controllers.values()),
}
"""Of each the packaged robot, and whether its simulated motors really are on."""


class Bench:
    """A robot's hardware and its simulated drives, a cycle at a time, with a bus that can fail."""

    def __init__(self, name: str) -> None:
        file = load_robot(name)
        self.rig = LockstepRig.of(hardware_of(file))
        robot = simulated_robot(file, self.rig.bus.attach("plant"))
        self.rig.attach(robot)
        self.link = FaultyLink(self.rig.bus.attach("node"))
        self.hardware: Any = build_robot(file, self.rig, self.link).hardware
        (self._device,) = robot.devices
        self._is_on = FAMILIES[name]
        self.hardware.open()
        self.cycles(80)

    def cycles(self, times: int, command: float = 0.0) -> list[bool]:
        """Whether the drives say that they are off, cycle by cycle; that is never so while they are on."""
        said = []
        for _ in range(times):
            self.rig.sleep_until_ns(self.rig.now_ns() + CYCLE_NS)
            self.sensors = self.hardware.exchange((command, command))
            assert not (self.sensors.off and self.is_on()), "said to be off, and is on"
            said.append(self.sensors.off)
        return said

    def is_on(self) -> bool:
        return self._is_on(self._device)

    def drive(self) -> None:
        assert self.hardware.arming_failures() == []
        self.hardware.arm()
        self.cycles(10)
        assert self.sensors.ready
        assert not any(self.cycles(20, 1.0)[2:])
        assert self.is_on()


@pytest.fixture(params=sorted(FAMILIES))
def bench(request: pytest.FixtureRequest) -> Bench:
    return Bench(request.param)


def test_drives_that_have_not_been_armed_report_that_they_are_off(bench: Bench) -> None:
    assert all(bench.cycles(5))


def test_drives_that_are_being_switched_on_are_not_reported_off(bench: Bench) -> None:
    bench.hardware.arm()
    assert not any(bench.cycles(10))


def test_a_stop_is_reported_within_a_few_cycles_and_stays_reported(bench: Bench) -> None:
    bench.drive()
    bench.hardware.disarm()
    said = bench.cycles(30)
    assert True in said[:CONFIRMED_WITHIN]
    assert all(said[said.index(True) :])


def test_a_stop_that_does_not_reach_the_drives_is_not_reported_while_they_are_on(bench: Bench) -> None:
    bench.drive()
    bench.link.fault = LinkFault.QUEUE_FULL
    bench.hardware.disarm()
    assert bench.cycles(3) == [False] * 3, "they are on until their own watchdog acts"
    assert bench.is_on()
    bench.cycles(30)
    assert not bench.is_on()
    bench.link.fault = None
    assert bench.cycles(30)[-1], "and are heard to be off by now"


def test_silent_drives_are_not_reported_off_though_they_are(bench: Bench) -> None:
    bench.drive()
    bench.link.fault = LinkFault.STALE
    bench.hardware.disarm()
    assert not any(bench.cycles(40))
    assert not bench.is_on()
    bench.link.fault = None
    assert bench.cycles(CONFIRMED_WITHIN)[-1]


def test_an_old_report_of_off_expires(bench: Bench) -> None:
    bench.link.fault = LinkFault.STALE
    said = bench.cycles(60)
    assert said[0]
    assert not any(said[-10:])
