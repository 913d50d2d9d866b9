# SPDX-License-Identifier: MIT
"""A robot and, where it has hardware, its simulated plant and bus on one simulated clock."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from segway_ecc.hil.rig.simulation import LockstepRig, simulated_robot
from segway_ecc.node.config import NoHardwareSection, RobotFile
from segway_ecc.node.robot import Robot, build_robot

_BITRATE: Final = 500_000
"""Of the bus that nothing is on, bit/s."""


@dataclass(frozen=True, slots=True)
class SimulatedRobotInRos:
    """A robot on a simulated clock, ready to run.

    Attributes:
        robot: It, on the rig's clock.
        refused_frames: How many frames its simulated devices have refused.
    """

    robot: Robot
    refused_frames: Callable[[], int]


@contextlib.contextmanager
def simulated(file: RobotFile) -> Iterator[SimulatedRobotInRos]:
    """Join a robot with its simulated devices and plant; one that is all model has none.

    Raises:
        NoSimulationError: Its file names no plant, or none for its drives.
        ConfigurationError, ModelError: It cannot be built.
    """
    if isinstance(file.hardware, NoHardwareSection):
        yield SimulatedRobotInRos(build_robot(file, LockstepRig(_BITRATE)), lambda: 0)
        return
    rig = LockstepRig.of(file.hardware)
    ends = rig.ends(file.hardware)
    devices = simulated_robot(file, ends.devices, ends.port, ends.imu_port)
    robot = build_robot(file, rig, ends.node)
    rig.attach(devices)
    with contextlib.closing(ends.devices):
        ends.devices.open()
        yield SimulatedRobotInRos(robot, lambda: devices.refused_frames)
