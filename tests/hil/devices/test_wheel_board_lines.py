# SPDX-License-Identifier: MIT
"""The board between two lines: the robot goes on over the serial line when the bus is lost, and nobody falls."""

from collections.abc import Sequence
from typing import NamedTuple

import pytest

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.drives.wheel_board.driver import WheelBoard
from segway_ecc.firmware_io.drives.wheel_board.frames import BoardState
from segway_ecc.firmware_io.drives.wheel_board.serial_codec import BoardSerialCodec
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.redundant_link import RedundantLink
from segway_ecc.firmware_io.links.serial_link import SerialLink
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.hil.devices.wheel_board import TICK_NS, SimulatedWheelBoard
from segway_ecc.hil.plants.cart import CartPlant
from segway_ecc.hil.rig.fronts import FaultyLink, LinkFault
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial
from segway_ecc.hil.rig.simulation import LockstepRig

MS = 1_000_000
CYCLE_NS = 10 * MS
ARM_AT, CYCLES = 20, 75


class Seen(NamedTuple):
    """What one cycle showed."""

    faults: Sequence[str]
    is_ready: bool
    is_valid: bool
    state: BoardState


class Bench:
    """An assembly on a bus and a serial line to a board with an IMU and the cart's plant, in lock step."""

    def __init__(self, baudrate: int) -> None:
        self.rig = LockstepRig(500_000)
        wires = SimulatedSerial(baudrate, self.rig.now_ns)
        self.bus = FaultyLink(self.rig.bus.attach("node"))
        serial = SerialSettings(port="bench", baudrate=baudrate)
        fallback = SerialLink(serial, BoardSerialCodec(), self.rig.now_ns, wires.host.open)
        self.link = RedundantLink(self.bus, fallback, self.rig.now_ns)
        board_link = self.rig.bus.attach("board")
        self.board = SimulatedWheelBoard(board_link, WheelBoardSettings(imu=True), wires.device)
        self.rig.attach(SimulatedRobot(board_link, [self.board], CartPlant(), TICK_NS))
        driver = WheelBoard(self.link, WheelBoardSettings(imu=True), CYCLE_NS * 1e-9, self.rig.now_ns)
        self.robot = Assembly(self.link, [driver], now_ns=self.rig.now_ns)

    def run(self, fault: LinkFault | None, fault_at: int) -> list[Seen]:
        """Drive, with a fault from a cycle on; what was seen from there."""
        self.robot.open()
        seen = []
        for cycle in range(CYCLES):
            self.bus.fault = fault if cycle >= fault_at else None
            sensors = self.robot.exchange((1.0, 1.0))
            if cycle == ARM_AT:
                self.robot.arm()
            self.rig.sleep_until_ns(self.rig.now_ns() + CYCLE_NS)
            seen.append(Seen(sensors.faults, sensors.ready, all(sensors.valid), self.board.state))
        return seen[fault_at:]


@pytest.mark.parametrize("baudrate", [115_200, 921_600])
@pytest.mark.parametrize("fault", LinkFault)
def test_the_robot_goes_on_over_the_serial_line_whatever_happens_to_the_bus(fault: LinkFault, baudrate: int) -> None:
    # Standby is asked every tenth cycle, so eleven cycles in a row cover every phase of it.
    for fault_at in range(40, 51):
        bench = Bench(baudrate)
        seen = bench.run(fault, fault_at)

        assert bench.link.is_on_fallback
        assert not any(cycle.faults for cycle in seen)
        assert all(cycle.is_valid for cycle in seen)
        assert seen[-1].is_ready
        assert seen[-1].state is BoardState.ENABLED
        assert bench.board.refused_frames == 0
        switching = bench.robot.switching
        assert switching is not None
        (switch,) = switching.switches
        assert all(gap is not None and gap <= 60 * MS for gap in switch.gaps.values())


def test_without_a_fault_it_stays_on_the_bus() -> None:
    bench = Bench(115_200)
    seen = bench.run(None, 40)
    assert not bench.link.is_on_fallback
    assert {cycle[1:] for cycle in seen} == {(True, True, BoardState.ENABLED)}
    assert bench.board.refused_frames == 0


def test_disarmed_on_the_serial_line_the_board_is_off() -> None:
    bench = Bench(115_200)
    bench.run(LinkFault.CUT, 40)
    bench.robot.disarm()
    bench.rig.sleep_until_ns(bench.rig.now_ns() + CYCLE_NS)
    assert bench.board.state is BoardState.DISABLED
    assert tuple(bench.board.voltages) == (0.0, 0.0)
