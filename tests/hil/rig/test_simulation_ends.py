# SPDX-License-Identifier: MIT
"""Where node, devices and guard are joined in lock step: a bus, a serial line alone, an IMU's line beside either."""

import msgspec
import pytest

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.imus.icm42688_bridge.settings import Icm42688BridgeSettings
from segway_ecc.firmware_io.links.joined_link import JoinedLink
from segway_ecc.firmware_io.links.link import Frame, LinkState
from segway_ecc.firmware_io.links.serial_link import SerialLink
from segway_ecc.firmware_io.links.serial_writer import SerialWriter
from segway_ecc.firmware_io.links.settings import PortSettings
from segway_ecc.hil.rig.no_bus import NoBus
from segway_ecc.hil.rig.simulated_bus import SimulatedLink
from segway_ecc.hil.rig.simulation import LockstepRig, can_of, devices_link, hardware_of, simulated_robot
from segway_ecc.node.config import load_robot
from segway_ecc.node.robot import build_robot

BRIDGE = Icm42688BridgeSettings(serial=PortSettings(port="/dev/imu", baudrate=460_800))


def test_a_robot_on_a_bus_has_both_its_ends_there() -> None:
    settings = hardware_of(load_robot("cart-can"))
    rig = LockstepRig.of(settings)
    ends = rig.ends(settings)
    assert isinstance(ends.node, SimulatedLink)
    assert (ends.port, ends.imu_port) == (None, None)
    assert isinstance(rig.guard_end(settings, ends), SimulatedLink)
    assert can_of(settings).bitrate == 500_000
    assert not isinstance(devices_link(settings, RealClock()), NoBus)


def test_a_robot_on_a_serial_line_alone_has_both_its_ends_there() -> None:
    settings = hardware_of(load_robot("cart-hoverboard"))
    rig = LockstepRig.of(settings)
    ends = rig.ends(settings)
    assert isinstance(ends.node, SerialLink)
    assert ends.wires is not None
    assert ends.port is ends.wires.device
    assert isinstance(rig.guard_end(settings, ends), SerialWriter)
    assert isinstance(devices_link(settings, RealClock()), NoBus)


@pytest.mark.parametrize("robot", ["cart-can", "cart-hoverboard"])
def test_an_imu_on_a_line_of_its_own_is_measured_with_either(robot: str) -> None:
    file = load_robot(robot)
    settings = msgspec.structs.replace(hardware_of(file), external_imu=BRIDGE)
    file = msgspec.structs.replace(file, hardware=settings)
    rig = LockstepRig.of(settings)
    ends = rig.ends(settings)
    assert isinstance(ends.node, JoinedLink)
    simulated = simulated_robot(file, ends.devices, ends.port, ends.imu_port)
    rig.attach(simulated)
    hardware = build_robot(file, rig, ends.node).hardware
    hardware.open()
    for _ in range(20):
        rig.sleep_until_ns(rig.now_ns() + 10_000_000)
        sensors = hardware.exchange((0.0,) * len(hardware.commands))
    place = list(hardware.signals).index("imu.linear_acceleration_z")
    assert sensors.values[place] == pytest.approx(9.80665, abs=0.005)
    assert sensors.valid[place]


def test_nothing_passes_where_there_is_no_bus() -> None:
    bus = NoBus()
    bus.open()
    assert bus.send(Frame(1, b""))
    assert bus.receive() == []
    assert (bus.state, dict(bus.health), bus.counters.sent) == (LinkState.ACTIVE, {}, 0)
    bus.close()
