# SPDX-License-Identifier: MIT
"""What a node sees of simulated drives whose plant is late, as on a busy machine: by a clock that the test moves."""

from collections.abc import Callable, Sequence
from typing import ClassVar

import pytest

from segway_ecc.firmware_io.build import build_hardware
from segway_ecc.firmware_io.hardware import Hardware
from segway_ecc.hil.devices.family import simulated_drives
from segway_ecc.hil.rig.simulated_bus import SimulatedBus
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import WALL_START_NS, RealTimePlant, can_of, hardware_of
from segway_ecc.node.config import load_robot
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import SectionedModel
from segway_ecc.node.safety.check import View
from segway_ecc.node.safety.plausibility import VelocityAgreement
from segway_ecc.node.safety.settings import VelocityConsistency

MS = 1_000_000
PERIOD_NS = 5 * MS
SPEED = 20.0
"""Of both wheels, rad/s: 1 m/s of the segway."""
BEGIN_MS, END_MS = 1_000, 3_000
TOLERANCE = VelocityConsistency(tolerance_rad_s=3.0)
"""As the packaged segways have it, over 0.1 s."""
DRIVES = {"cart-can": None, "cart-odrive": "0.5.5", "cart-moteus": None}
"""Robots, and the release of the drives; ODrive 0.5.6 shows no motion before the motors are on. One that sends in each
tick, one that sends by its clock, one that answers."""


class Rolling(SectionedModel):
    """Two wheels that roll at a constant speed whatever the motors do."""

    name = "rolling"
    step_size = 0.001
    inputs: ClassVar[Sequence[Variable]] = ()
    outputs: ClassVar[Sequence[Variable]] = tuple(
        Variable(f"{side}.{what}") for side in ("left", "right") for what in ("angle", "velocity")
    )

    def initial(self) -> None:
        """Begin at zero."""
        self.steps = 0

    def input(self, u: Sequence[float]) -> None:  # noqa: ARG002 - nothing drives it
        """Take nothing."""
        self.steps += 1

    def output(self) -> Sequence[float]:
        """Where the wheels are, rad, and how fast, rad/s."""
        return (SPEED * self.steps * self.step_size, SPEED) * 2


class Machine:
    """A clock on which a node has its cycles on time, and the plant oversleeps at a moment, ns."""

    def __init__(self, late_ns: int) -> None:
        self.time_ns = 0
        self.cycle: Callable[[], None] = lambda: None
        self._late_ns, self._is_held = late_ns, False
        self._next_ns = PERIOD_NS

    def now_ns(self) -> int:
        return self.time_ns

    def wall_ns(self) -> int:
        return WALL_START_NS + self.time_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """The plant sleeps; the node's cycles until it wakes run meanwhile."""
        until_ns = max(self.time_ns + 20_000, deadline_ns)  # a tick takes 20 us
        if deadline_ns >= BEGIN_MS * MS and not self._is_held:
            self._is_held, until_ns = True, until_ns + self._late_ns
        while self._next_ns <= until_ns:
            self.time_ns = self._next_ns
            self._next_ns += PERIOD_NS
            self.cycle()
        self.time_ns = until_ns


class Node:
    """Reads the drives in each cycle, and looks at a wheel's velocity as an armed robot does."""

    def __init__(self, hardware: Hardware, plant: RealTimePlant, clock: Machine) -> None:
        self.faults: list[str] = []
        self.looked = 0
        self._hardware, self._plant, self._clock = hardware, plant, clock
        names = list(hardware.signals)
        places = names.index("left.angle"), names.index("left.velocity")
        self._check = VelocityAgreement("left", *places, TOLERANCE, PERIOD_NS * 1e-9)

    def cycle(self) -> None:
        """One of its cycles."""
        sensors = self._hardware.exchange((0.0, 0.0))
        found = self._check.look(View(sensors.values, [True] * len(sensors.values), 1))
        if self._clock.time_ns > BEGIN_MS * MS // 2:
            self.looked += 1
            self.faults += [] if found is None else [found]
        if self._clock.time_ns >= END_MS * MS:
            self._plant.stop()


def watched(robot: str, release: str | None, late_ns: int) -> tuple[Node, RealTimePlant]:
    """What a node has found whose drives' plant was late once."""
    clock, settings = Machine(late_ns), hardware_of(load_robot(robot))
    can = can_of(settings)
    bus = SimulatedBus(can.bitrate, clock.now_ns, can.fd_bitrate)
    drives, link = simulated_drives(settings), bus.attach("plant")
    device = (drives.device if release is None else drives.variants[release])(settings, link, None)

    class Driven(Rolling):
        inputs: ClassVar[Sequence[Variable]] = tuple(Variable(name) for name in device.inputs)

    plant = RealTimePlant(SimulatedRobot(link, [device], Driven(), drives.tick_ns), clock)
    hardware = build_hardware(settings, PERIOD_NS * 1e-9, clock, bus.attach("node"))
    hardware.open()
    node = Node(hardware, plant, clock)
    clock.cycle = node.cycle
    plant.run(None)
    return node, plant


@pytest.mark.parametrize("late_ms", [0, 4, 17, 27, 60])
@pytest.mark.parametrize(("robot", "release"), DRIVES.items(), ids=list(DRIVES))
def test_velocity_agrees_with_the_angle_however_late_the_plant_is(
    robot: str, release: str | None, late_ms: int
) -> None:
    node, plant = watched(robot, release, late_ms * MS)

    assert node.faults == []
    assert node.looked == 500
    assert (plant.late > 0) is (late_ms * MS > plant.robot.tick_ns)
    assert plant.ticks >= END_MS * MS // plant.robot.tick_ns, "the laws of physics skip nothing"
