# SPDX-License-Identifier: MIT
"""ODrive 0.5 between two lines: the robot goes on over the ASCII protocol when the bus is lost."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec
import pytest

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.drives.odrive.driver import Odrive
from segway_ecc.firmware_io.drives.odrive.messages import AxisState
from segway_ecc.firmware_io.drives.odrive.serial_codec import OdriveSerialCodec
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.links.redundant_link import RedundantLink
from segway_ecc.firmware_io.links.serial_link import SerialLink
from segway_ecc.hil.devices.odrive import TICK_NS, SimulatedOdrive
from segway_ecc.hil.plants.cart import CartTorquePlant
from segway_ecc.hil.rig.fronts import FaultyLink, LinkFault
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial
from segway_ecc.hil.rig.simulation import LockstepRig

MS = 1_000_000
CYCLE_NS = 10 * MS
ARM_AT, FAULT_AT, CYCLES = 190, 235, 275
"""The line in standby is asked ten times a second; before arming it gives the board's settings, in 17 polls. About the
fault it is asked for one of them again."""


class Seen(NamedTuple):
    """What one cycle showed."""

    faults: Sequence[str]
    is_ready: bool
    is_valid: bool
    states: set[AxisState]


class Bench:
    """An assembly on a bus and a serial line to a board with the cart's plant, in lock step."""

    def __init__(self, baudrate: int) -> None:
        wheel: dict[str, Any] = {"max_torque": 3.0}
        settings = msgspec.convert(
            {
                "type": "odrive",
                "firmware": "0.5",
                "axes": {"left": {**wheel, "node_id": 0, "axis": 0}, "right": {**wheel, "node_id": 1, "axis": 1}},
                "serial": {"port": "bench", "baudrate": baudrate},
            },
            OdriveSettings,
        )
        assert settings.serial is not None
        self.rig = LockstepRig(500_000)
        self.wires = SimulatedSerial(baudrate, self.rig.now_ns)
        self.bus = FaultyLink(self.rig.bus.attach("node"))
        self.line = OdriveSerialCodec(settings)
        fallback = SerialLink(settings.serial, self.line, self.rig.now_ns, self.wires.host.open)
        self.link = RedundantLink(self.bus, fallback, self.rig.now_ns)
        drives_link = self.rig.bus.attach("drives")
        self.device = SimulatedOdrive(drives_link, settings, self.wires.device)
        self.plant = SimulatedRobot(drives_link, [self.device], CartTorquePlant(), TICK_NS)
        self.rig.attach(self.plant)
        drives = [Odrive(self.link, name, settings, CYCLE_NS * 1e-9, self.rig.now_ns) for name in ("left", "right")]
        self.robot = Assembly(self.link, drives, now_ns=self.rig.now_ns)

    def run(self, fault: LinkFault | None, fault_at: int) -> list[Seen]:
        """Drive, with a fault from a cycle on; what was seen from there."""
        self.robot.open()
        seen = []
        for cycle in range(CYCLES):
            self.bus.fault = fault if cycle >= fault_at else None
            sensors = self.robot.exchange((0.01, 0.01))
            if cycle == ARM_AT:
                self.robot.arm()
            self.rig.sleep_until_ns(self.rig.now_ns() + CYCLE_NS)
            valid = dict(zip(self.robot.signals, sensors.valid, strict=True))
            is_valid = all(valid[name] for name in valid if "torque" not in name)
            seen.append(Seen(sensors.faults, sensors.ready, is_valid, {axis.state for axis in self.device.axes}))
        return seen[fault_at:]


@pytest.mark.variants(4)
@pytest.mark.parametrize(("baudrate", "torque_gap_ms"), [(460_800, 60), (921_600, 60)])
@pytest.mark.parametrize("fault", LinkFault)
def test_the_robot_goes_on_over_the_serial_line_whatever_happens_to_the_bus(
    fault: LinkFault, baudrate: int, torque_gap_ms: int
) -> None:
    for fault_at in range(FAULT_AT, FAULT_AT + 11):
        bench = Bench(baudrate)
        seen = bench.run(fault, fault_at)

        assert bench.link.is_on_fallback
        assert not [fault for cycle in seen for fault in cycle.faults]
        assert all(cycle.is_valid for cycle in seen)
        assert seen[-1].is_ready
        assert seen[-1].states == {AxisState.CLOSED_LOOP_CONTROL}
        switching = bench.robot.switching
        assert switching is not None
        (switch,) = switching.switches
        gaps = switch.gaps
        assert (gaps["telemetry_gap"] or 1e9) <= 60 * MS
        assert (gaps["torque_gap"] or 1e9) <= torque_gap_ms * MS


def test_without_a_fault_it_stays_on_the_bus_and_the_line_loses_nothing() -> None:
    bench = Bench(460_800)
    seen = bench.run(None, FAULT_AT)
    assert not bench.link.is_on_fallback
    assert {(cycle.is_ready, cycle.is_valid) for cycle in seen} == {(True, True)}
    assert not bench.line.refused
    assert bench.device.refused_frames == 0


@pytest.mark.parametrize("baudrate", [460_800, 921_600])
def test_on_the_serial_line_the_supply_is_asked_for_and_followed(baudrate: int) -> None:
    bench = Bench(baudrate)
    bench.run(LinkFault.CUT, FAULT_AT)
    place = list(bench.robot.signals).index("supply.voltage")
    bench.plant.stuck["truth.supply_voltage"] = 21.5
    seen = []
    for _ in range(150):
        bench.rig.sleep_until_ns(bench.rig.now_ns() + CYCLE_NS)
        sensors = bench.robot.exchange((0.0, 0.0))
        seen.append((sensors.values[place], sensors.ages[place], sensors.valid[place]))
    assert all(valid for *_, valid in seen)
    assert max(age for _, age, _ in seen) <= 0.2
    assert seen[-1][0] == pytest.approx(21.5)


def test_disarmed_on_the_serial_line_the_axes_are_idle_and_can_be_armed_again() -> None:
    bench = Bench(921_600)
    bench.run(LinkFault.CUT, FAULT_AT)
    bench.robot.disarm()
    for _ in range(3):
        bench.rig.sleep_until_ns(bench.rig.now_ns() + CYCLE_NS)
        bench.robot.exchange((0.0, 0.0))
    assert {axis.state for axis in bench.device.axes} == {AxisState.IDLE}
    bench.robot.arm()
    for _ in range(8):
        sensors = bench.robot.exchange((0.0, 0.0))
        bench.rig.sleep_until_ns(bench.rig.now_ns() + CYCLE_NS)
    assert sensors.ready


def test_a_noisy_line_loses_polls_and_never_mixes_up_the_wheels() -> None:
    bench = Bench(921_600)
    bench.run(LinkFault.CUT, FAULT_AT)
    for cycle in range(30):
        if cycle % 7 == 0:
            bench.wires.host.inject(b"\x00*12\r")
        sensors = bench.robot.exchange((0.02, -0.02))
        bench.rig.sleep_until_ns(bench.rig.now_ns() + CYCLE_NS)
    speeds = dict(zip(bench.robot.signals, sensors.values, strict=True))
    assert speeds["left.velocity"] > speeds["right.velocity"]
    assert bench.line.refused.total() > 0
