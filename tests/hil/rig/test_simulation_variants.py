# SPDX-License-Identifier: MIT
"""Which release or kind of drive is simulated is a setting of the robot file."""

from typing import Any

import pytest
from msgspec.structs import replace

from segway_ecc.hil.devices.family import simulated_drives
from segway_ecc.hil.devices.odrive import Release, SimulatedOdrive
from segway_ecc.hil.errors import NoSimulationError
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import RobotFile, decode_robot, load_robot, read_text
from segway_ecc.node.robot import build_robot

CYCLE_NS = 10_000_000
CANNOT = {"weak": "max_torque takes", "profile-torque": "profile torque alone", "silent-refusal": "it stays in mode 0"}
"""What is refused, and how."""


def with_drives(robot: str, drives: str) -> RobotFile:
    text = read_text(robot)
    assert text.count("\nsimulation:\n") == 1
    return decode_robot(text.replace("\nsimulation:\n", f"\nsimulation:\n  drives: '{drives}'\n"), "r.yaml")


VARIANTS = [
    (robot, name)
    for robot in ("cart-odrive", "cart-vesc", "cart-cia402")
    for name in simulated_drives(hardware_of(load_robot(robot))).variants
]


@pytest.mark.parametrize(("robot", "name"), VARIANTS)
def test_each_is_armed_or_refused_with_its_reason(robot: str, name: str) -> None:
    file = with_drives(robot, name)
    hardware: Any = file.hardware
    if robot == "cart-odrive":
        hardware = replace(hardware, firmware=Release(name).firmware.value)
        file = replace(file, hardware=hardware)
    rig = LockstepRig(hardware.can.bitrate)
    end = rig.bus.attach("drives")
    simulated = simulated_robot(file, end)
    rig.attach(simulated)
    robot_hardware = build_robot(file, rig, rig.bus.attach("node")).hardware
    end.open()
    robot_hardware.open()
    for _ in range(200):
        robot_hardware.exchange((0.0, 0.0))
        rig.sleep_until_ns(rig.now_ns() + CYCLE_NS)
    failures = "; ".join(robot_hardware.arming_failures())
    assert CANNOT[name] in failures if name in CANNOT else not failures
    device = simulated.devices[0]
    if isinstance(device, SimulatedOdrive):
        assert device.release == name


def test_a_name_that_is_not_simulated_is_refused_with_those_that_are() -> None:
    file = with_drives("cart-odrive", "0.4.12")
    with pytest.raises(NoSimulationError, match=r"simulation\.drives is '0\.4\.12', simulated are 0\.5\.4, 0\.5\.5"):
        simulated_robot(file, LockstepRig(500_000).bus.attach("drives"))


def test_a_family_without_variants_says_so() -> None:
    file = with_drives("cart-can", "2")
    with pytest.raises(NoSimulationError, match="simulated are none: leave it out"):
        simulated_robot(file, LockstepRig(500_000).bus.attach("drives"))
