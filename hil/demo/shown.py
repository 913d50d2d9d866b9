# SPDX-License-Identifier: MIT
"""The robot that is shown, and how its station reaches it: as processes over ROS, or in lock step in this process."""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

from segway_ecc.deploy.station.archive_client import Archives
from segway_ecc.deploy.station.network import Connect
from segway_ecc.deploy.station.station import OVER_ROS
from segway_ecc.deploy.support.archive_service import ArchiveCalls, NoArchiveError
from segway_ecc.firmware_io.clock import Clock, RealClock
from segway_ecc.hil.demo.lockstep_robot import LockstepRobot
from segway_ecc.hil.demo.parts import DemoParts, Parts, PartsSetup
from segway_ecc.hil.processes import inherited, own_ros_domain, quiet
from segway_ecc.node.config import RobotFile

LOGS: Final = "logs"
"""Of the folder of a demo, where its robot's logs are."""


class ShownRobot(NamedTuple):
    """What a demo has of its robot.

    Attributes:
        parts: What is done to it.
        clock: Its time.
        connect: How a station reaches it.
        archives: How its archive of logs is asked, beside the logs on this machine.
    """

    parts: Parts
    clock: Clock
    connect: Connect
    archives: Archives


class _NoArchives:
    """A robot whose logs are all on this machine; see `Archives`."""

    def ask(self, robot: str, _name: str) -> NoReturn:
        """There is none to ask."""
        raise NoArchiveError(robot)

    def close(self) -> None:
        """There is nothing to close."""


@contextlib.contextmanager
def over_processes(source: str, file: RobotFile, folder: Path) -> Iterator[ShownRobot]:
    """Plant, guard and node of the robot file `source` as processes, over ROS in a domain of their own."""
    bus = ("--interface", "local", "--channel", f"demo_{os.getpid()}")
    setup = PartsSetup(source, bus, folder, ("--ros", "--log", str(folder / LOGS / f"{file.name}.mcap")))
    with contextlib.ExitStack() as stack:
        # A domain of its own: no real robot of this network is on the page, and nobody else finds this one.
        for name, value in own_ros_domain().items():
            stack.enter_context(inherited(name, value))
        sys.stderr.write(f"segway-ecc: starting '{source}', its plant and its guard\n")
        parts = stack.enter_context(DemoParts(setup))
        yield ShownRobot(parts, RealClock(), OVER_ROS, ArchiveCalls())


@contextlib.contextmanager
def in_lock_step(source: str, file: RobotFile, folder: Path) -> Iterator[ShownRobot]:
    """The same in one thread of this process, without ROS; see `LockstepRobot`."""
    robot = LockstepRobot(file, folder / LOGS, RealClock())
    sys.stderr.write(f"segway-ecc: '{source}', its plant and its guard run in lock step, without ROS\n")
    with quiet("segway_ecc.node.cycle", "segway_ecc.firmware_io"), robot:
        yield ShownRobot(robot, robot.clock, robot.network.connect, _NoArchives())
