# SPDX-License-Identifier: MIT
"""The simulated bridge at one end of a line, the driver at the other."""

import pytest

from segway_ecc.firmware_io.imus.icm42688_bridge.driver import Icm42688
from segway_ecc.firmware_io.imus.icm42688_bridge.frames import BridgeCodec
from segway_ecc.firmware_io.imus.icm42688_bridge.settings import Icm42688BridgeSettings
from segway_ecc.firmware_io.links.serial_link import SerialLink
from segway_ecc.firmware_io.links.settings import PortSettings
from segway_ecc.hil.devices.family import simulated_imu
from segway_ecc.hil.devices.icm42688_bridge import SimulatedIcm42688Bridge
from segway_ecc.hil.rig.no_bus import NoBus
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial
from segway_ecc.hil.rig.simulation import LockstepRig

MS = 1_000_000
SETTINGS = Icm42688BridgeSettings(
    serial=PortSettings(port="test", baudrate=460_800), mounting=("+y", "-x", "+z"), period_s=0.005
)
MEASURED = {
    "imu.angular_velocity_x": 0.5,
    "imu.angular_velocity_y": -1.0,
    "imu.angular_velocity_z": 0.25,
    "imu.linear_acceleration_x": 1.0,
    "imu.linear_acceleration_y": -2.0,
    "imu.linear_acceleration_z": 9.81,
}


class Bench:
    """Bridge, line and driver, a cycle at a time."""

    def __init__(self) -> None:
        self.rig = LockstepRig(500_000)
        wires = SimulatedSerial(SETTINGS.serial.baudrate, self.rig.now_ns)
        self.link = SerialLink(SETTINGS.serial, BridgeCodec(), self.rig.now_ns, wires.host.open)
        self.link.open()
        self.device = SimulatedIcm42688Bridge(SETTINGS, wires.device)
        self.imu = Icm42688(SETTINGS, 0.01, self.rig)

    def run(self, milliseconds: int) -> int:
        taken = 0
        for _ in range(milliseconds):
            assert self.device.obey((), self.rig.now_ns(), MEASURED) == ()
            self.device.send_telemetry(self.rig.now_ns(), MEASURED)
            self.rig.sleep_until_ns(self.rig.now_ns() + MS)
            taken += sum(map(self.imu.take_frame, self.link.receive()))
        return taken


def test_what_is_measured_comes_out_in_the_robot_s_axes_at_its_rate() -> None:
    bench = Bench()
    assert bench.run(1_000) == 200
    assert bench.imu.read().values == pytest.approx(tuple(MEASURED.values()), abs=0.003)


def test_a_sensor_that_does_not_answer_leaves_the_bridge_silent() -> None:
    bench = Bench()
    bench.run(20)
    bench.device.powered = False
    bench.run(60)
    assert not any(bench.imu.read().valid)
    bench.device.powered = True
    bench.run(20)
    assert all(bench.imu.read().valid)
    assert bench.device.refused_frames == 0


def test_it_needs_a_line_and_is_found_by_its_name() -> None:
    simulated = simulated_imu(SETTINGS)
    assert simulated.frames(SETTINGS) == ()
    with pytest.raises(ValueError, match="a serial line of its own"):
        simulated.device(SETTINGS, NoBus(), None)
