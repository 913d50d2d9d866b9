# SPDX-License-Identifier: MIT
"""Settings of a new ODrive are read back before arming, over CAN from 0.6 and over the serial line from 0.5."""

from typing import Any

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.drives.odrive.driver import Odrive
from segway_ecc.firmware_io.drives.odrive.serial_codec import OdriveSerialCodec
from segway_ecc.firmware_io.drives.odrive.setting_names import OwnSetting
from segway_ecc.firmware_io.drives.odrive.settings import OdriveEndpoints, OdriveSettings
from segway_ecc.firmware_io.drives.readings import readings_of
from segway_ecc.firmware_io.links.redundant_link import RedundantLink
from segway_ecc.firmware_io.links.serial_link import SerialLink
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.hil.devices._odrive_board import ENDPOINTS, FACTORY_NEGATIVE_CURRENT_A
from segway_ecc.hil.devices.odrive import TICK_NS, SimulatedOdrive
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial
from segway_ecc.hil.rig.simulation import LockstepRig, simulated_plant
from segway_ecc.node.config import load_robot

CYCLE_NS = 10_000_000
BAUDRATE = 921_600
IDS = {name: number for number, name in ENDPOINTS.items()}
READABLE = {
    "axis0.controller.config.vel_limit",
    "axis0.controller.config.enable_overspeed_error",
    "axis0.controller.config.enable_torque_mode_vel_limit",
    "axis0.config.motor.current_soft_max",
    "axis0.config.torque_soft_max",
    "axis0.config.enable_watchdog",
    "axis0.config.watchdog_timeout",
    "config.dc_max_negative_current",
    "config.brake_resistor0.enable",
}


class Cart:
    """The cart's drives, as they are delivered in one respect, and their drivers, a cycle at a time."""

    def __init__(self, line: str, **endpoints: Any) -> None:
        file = load_robot("cart-odrive")
        assert isinstance(file.hardware, OdriveSettings)
        changes: dict[str, Any] = {"serial": SerialSettings(port="bench", baudrate=BAUDRATE)}
        if line == "can":
            ids = {name: IDS[name] for name in sorted(READABLE)}
            versions = {"firmware": "0.6.10", "hardware": "4.4.58", "ids": ids, **endpoints}
            changes = {"firmware": "0.6", "endpoints": OdriveEndpoints(**versions)}
        settings = replace(file.hardware, **changes)
        self.rig = LockstepRig(settings.can.bitrate)
        end, wires = self.rig.bus.attach("drives"), SimulatedSerial(BAUDRATE, self.rig.now_ns)
        self.device = SimulatedOdrive(end, settings, wires.device if settings.serial else None)
        self.rig.attach(SimulatedRobot(end, [self.device], simulated_plant(file), TICK_NS))
        link: Any = self.rig.bus.attach("node")
        if settings.serial is not None:
            codec = OdriveSerialCodec(settings)
            serial = SerialLink(settings.serial, codec, self.rig.now_ns, wires.host.open)
            link = RedundantLink(link, serial, self.rig.now_ns)
        drives = [Odrive(link, name, settings, CYCLE_NS * 1e-9, self.rig.now_ns) for name in ("left", "right")]
        self.robot = Assembly(link, drives, now_ns=self.rig.now_ns)
        self.robot.open()

    def run(self, cycles: int) -> None:
        for _ in range(cycles):
            self.robot.exchange((0.0, 0.0))
            self.rig.sleep_until_ns(self.rig.now_ns() + CYCLE_NS)


@pytest.mark.parametrize("line", ["can", "serial"])
def test_what_fits_is_read_and_the_robot_is_armed(line: str) -> None:
    cart = Cart(line)
    cart.run(10)
    assert any("are being" in failure for failure in cart.robot.arming_failures())
    cart.run(190)
    assert cart.robot.arming_failures() == []
    cart.robot.arm()
    cart.run(20)
    assert cart.robot.exchange((0.0, 0.0)).ready
    names = {reading.name for reading in readings_of(cart.robot)}
    assert {"left_vel_limit_turns_s", "right_watchdog_timeout_s"} <= names
    assert len(names) == 2 * len(OwnSetting)
    assert cart.device.refused_frames == 0


@pytest.mark.parametrize("line", ["can", "serial"])
def test_a_trap_refuses_arming_with_the_command_and_is_gone_once_it_was_typed(line: str) -> None:
    cart = Cart(line)
    axis = cart.device.axes[1]
    axis.velocity_limit_rev_s = 2.0
    for board in cart.device.boards:
        board.dc_max_negative_current_a = FACTORY_NEGATIVE_CURRENT_A
    cart.run(200)
    failures = cart.robot.arming_failures()
    name = "axis0" if line == "can" else "axis1"
    wanted = f"{name}.controller.config.vel_limit is 2 turns/s, max_velocity takes 41.38 turns/s; type in odrivetool"
    assert sum(wanted in failure for failure in failures) == 1
    assert sum("odrv0.config.dc_max_negative_current = -10" in failure for failure in failures) == 2
    assert len(failures) == 3

    axis.velocity_limit_rev_s = 45.0
    for board in cart.device.boards:
        board.dc_max_negative_current_a = -20.0
    cart.run(1_700)
    assert cart.robot.arming_failures() == []


@pytest.mark.parametrize("line", ["can", "serial"])
def test_board_with_a_brake_resistor_may_take_no_current_back(line: str) -> None:
    cart = Cart(line)
    for board in cart.device.boards:
        board.dc_max_negative_current_a, board.enable_brake_resistor = FACTORY_NEGATIVE_CURRENT_A, True
    cart.run(220)
    assert cart.robot.arming_failures() == []


@pytest.mark.parametrize("changes", [{"firmware": "0.6.11"}, {"hardware": "5.0.0"}])
def test_endpoints_of_another_drive_are_not_read(changes: dict[str, str]) -> None:
    cart = Cart("can", **changes)
    cart.run(150)
    failures = cart.robot.arming_failures()
    assert len(failures) == 2
    assert all("is firmware 0.6.10 on hardware 4.4.58, the endpoints in the robot file are of" in f for f in failures)
    assert readings_of(cart.robot) == []


def test_an_endpoint_that_is_wrong_is_not_answered_and_named() -> None:
    cart = Cart("can", ids={"axis0.controller.config.vel_limit": 9_999})
    cart.run(150)
    assert all("does not answer for axis0.controller.config.vel_limit" in f for f in cart.robot.arming_failures())
    assert len(cart.robot.arming_failures()) == 2


def test_nothing_is_asked_over_can_while_the_robot_is_armed() -> None:
    cart = Cart("can")
    listener = cart.rig.bus.attach("listener")
    cart.run(150)
    cart.robot.arm()
    cart.run(2)
    listener.receive()
    cart.run(500)
    assert not any(frame.arbitration_id % 32 in (0x00, 0x04) for frame in listener.receive())
