# SPDX-License-Identifier: MIT
"""The loop in real time with ROS and its recorder: subscribers in another process, and robots side by side."""

import contextlib
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.hil.errors import RigError
from segway_ecc.hil.growth.cost import Axis, Point, together
from segway_ecc.hil.growth.robot import RobotCost
from segway_ecc.hil.processes import Command, command

ROBOT: Final = "cart"
"""All of it is model: no bus, and no plant in another process that would take its part of the processors."""
MEASURED_S: Final = 3.0
_ANSWER_S: Final = 90.0
_DOMAINS: Final = 101


def subscribers(count: int) -> Point:
    """The cost with so many subscribers to the odometry, each a participant of its own, all in one other process.

    Raises:
        ProcessFailedError: A process ended with an error.
        RigError: Not every subscriber received from the robot.
    """
    with _side_by_side(1) as (folder, (robot,), environment), contextlib.ExitStack() as stack:
        if count:
            words = [_namespace(0), str(count)]
            listening = command(
                words, folder / "listeners.txt", environment, module="segway_ecc.hil.growth.listeners", listens=True
            )
            receiving = int(stack.enter_context(listening).ask("listen", _ANSWER_S))
            if receiving != count:
                raise RigError(f"only {receiving} of {count} subscribers received from the robot")
        costs = _measured([robot])
    return _point(Axis.SUBSCRIBERS, count, costs)


def robots(count: int) -> Point:
    """The cost of each of so many robots that run at once, in one ROS domain.

    Raises:
        ProcessFailedError: One of them ended with an error.
    """
    with _side_by_side(count) as (_, running, _):
        costs = _measured(running)
    return _point(Axis.ROBOTS, count, costs)


@contextlib.contextmanager
def _side_by_side(count: int) -> Iterator[tuple[Path, list[Command], dict[str, str]]]:
    """So many robots that run, each in a namespace of its own, and nobody else in their ROS domain."""
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(1 + os.getpid() % _DOMAINS)}
    with tempfile.TemporaryDirectory(prefix="segway-ecc-growth-") as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        running = []
        for i in range(count):
            words = [ROBOT, "--namespace", _namespace(i), "--log", str(folder / f"robot{i}.mcap")]
            started = command(
                words, folder / f"robot{i}.txt", environment, module="segway_ecc.hil.growth.robot", listens=True
            )
            running.append(stack.enter_context(started))
        for robot in running:
            robot.ask("ready", _ANSWER_S)
        yield folder, running, environment


def _measured(running: list[Command]) -> list[RobotCost]:
    for robot in running:
        robot.ask("begin", _ANSWER_S)
    time.sleep(MEASURED_S)
    return [msgspec.json.decode(robot.ask("end", _ANSWER_S), type=RobotCost) for robot in running]


def _point(axis: Axis, size: int, costs: list[RobotCost]) -> Point:
    notes = {
        "share of a core, all threads": f"{sum(t.cpu for t in costs):.2f}",
        "cycles that began late": f"{max(t.late for t in costs):.1%}",
    }
    return Point(axis=axis, size=size, cost=msgspec.structs.replace(together([t.cost for t in costs]), notes=notes))


def _namespace(place: int) -> str:
    return f"/growth{place}"
