# SPDX-License-Identifier: MIT
"""The bus lost under the driving cart: every cause with every drive that has a serial line, in lock step."""

import math
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.build import make_link, serial_of
from segway_ecc.firmware_io.links.redundant_link import RedundantLink
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.firmware_io.switching import Switch
from segway_ecc.hil.drill.failover import MANOEUVRE, Failover
from segway_ecc.hil.rig.fronts import FaultyLink, LinkFault
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import NoHardwareSection, RobotFile, load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord, NoRecorder
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import ACTIVE, Mode
from segway_ecc.node.sequence.manoeuvre import ManoeuvreStage, Player

ROBOTS = ["cart-can", "cart-odrive", "cart-vesc"]
SWITCH_WITHIN_NS = 50_000_000


class Breaker(NoRecorder):
    """Breaks the bus after a number of cycles of driving, and mends it after another, if any."""

    def __init__(self, bus: FaultyLink, fault: LinkFault | None, at: int, clear_at: int | None = None) -> None:
        self._bus, self._fault, self._at, self._mend_at = bus, fault, at, clear_at
        self._active = 0

    def write(self, record: CycleRecord) -> None:
        self._active += record.mode in ACTIVE
        if self._active == self._at:
            self._bus.fault = self._fault
        if self._active == self._mend_at:
            self._bus.fault = None


@dataclass(frozen=True)
class Drive:
    """What came of a drive."""

    place: tuple[float, float]
    loop: Loop
    switches: list[Switch]
    owner: str


def with_serial(name: str, baudrate: int = 921_600) -> RobotFile:
    file = load_robot(name)
    assert not isinstance(file.hardware, NoHardwareSection)
    serial = SerialSettings(port="simulated", baudrate=baudrate)
    return msgspec.structs.replace(file, hardware=msgspec.structs.replace(file.hardware, serial=serial))


def drive(file: RobotFile, fault: LinkFault | None, at: int = 200, clear_at: int | None = None) -> Drive:
    hardware = file.hardware
    assert not isinstance(hardware, NoHardwareSection)
    serial = serial_of(hardware)
    assert isinstance(serial, SerialSettings)
    rig = LockstepRig.of(hardware_of(file))
    wires = SimulatedSerial(serial.baudrate, rig.now_ns)
    plant = simulated_robot(file, rig.bus.attach("plant"), wires.device)
    rig.attach(plant)
    bus = FaultyLink(rig.bus.attach("node"))
    link = make_link(hardware, rig, bus, wires.host.open)
    assert isinstance(link, RedundantLink)
    robot = build_robot(file, rig, link)
    stage = ManoeuvreStage(Player(MANOEUVRE), list(robot.wiring.published), rig)
    loop = robot.loop(stage, Breaker(bus, fault, at, clear_at))
    loop.run(2_000)
    assert isinstance(robot.hardware, Assembly)
    assert robot.hardware.switching is not None
    x, y = (plant.outputs[plant.output_names.index(name)] for name in ("truth.x", "truth.y"))
    return Drive((x, y), loop, list(robot.hardware.switching.switches), link.owner_name)


@pytest.mark.variants(6)
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("fault", LinkFault)
def test_the_serial_line_carries_the_cart_on_within_50_ms(robot: str, fault: LinkFault) -> None:
    file = with_serial(robot)
    undisturbed, disturbed = drive(file, None), drive(file, fault)

    assert undisturbed.switches == []
    assert disturbed.loop.stop_reason == "the sequence is over"
    assert disturbed.loop.modes.mode is Mode.ARMED
    (switch,) = disturbed.switches
    assert switch.telemetry_gap_ns is not None
    assert switch.torque_gap_ns is not None
    assert switch.telemetry_gap_ns <= SWITCH_WITHIN_NS
    assert switch.torque_gap_ns <= SWITCH_WITHIN_NS
    assert math.dist(disturbed.place, undisturbed.place) < 0.05


@pytest.mark.parametrize("phase", range(7))
def test_it_does_whenever_the_cable_is_cut(phase: int) -> None:
    disturbed = drive(with_serial("cart-can"), LinkFault.CUT, at=150 + 13 * phase)
    (switch,) = disturbed.switches
    assert disturbed.loop.stop_reason == "the sequence is over"
    assert switch.torque_gap_ns is not None
    assert switch.torque_gap_ns <= SWITCH_WITHIN_NS


def test_the_bus_that_comes_back_is_not_taken_while_the_robot_is_armed() -> None:
    disturbed = drive(with_serial("cart-can"), LinkFault.UNPLUGGED, at=150, clear_at=170)
    assert disturbed.loop.stop_reason == "the sequence is over"
    assert len(disturbed.switches) == 1
    assert disturbed.owner == "serial"


def test_a_fault_without_a_serial_line_to_fall_back_on_stops_the_motors() -> None:
    file = load_robot("cart-can")
    rig = LockstepRig.of(hardware_of(file))
    plant = simulated_robot(file, rig.bus.attach("plant"))
    rig.attach(plant)
    bus = FaultyLink(rig.bus.attach("node"))
    robot = build_robot(file, rig, bus)
    stage = ManoeuvreStage(Player(MANOEUVRE), list(robot.wiring.published), rig)
    loop = robot.loop(stage, Breaker(bus, LinkFault.CUT, 200))
    loop.run(2_000)
    assert stage.is_broken_off
    assert loop.modes.mode is Mode.FAULT
    rig.sleep_until_ns(rig.now_ns() + 100_000_000)
    assert set(plant.inputs) == {0.0}


def test_drives_without_a_serial_line_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"^the drives of robot 'cart' have no serial line to fall back on$"):
        Failover("cart", load_robot("cart"), tmp_path)
