# SPDX-License-Identifier: MIT
"""The loop in real time with ROS and its recorder: subscribers in another process, and robots side by side.

As a program, the subscribers to the odometry, each a ROS participant of its own: arguments NAMESPACE COUNT. For the
first line on its standard input it answers how many of them have received from the robot, once all have; then it
listens until its standard input ends.
"""

import contextlib
import select
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.hil.errors import RigError
from segway_ecc.hil.growth.cost import Axis, Point, together
from segway_ecc.hil.growth.robot import RobotCost
from segway_ecc.hil.processes import Command, command, own_ros_domain
from segway_ecc.node.ros.messages import RosObject, message_type
from segway_ecc.node.ros.runtime import ros_node

ROBOT: Final = "cart"
"""All of it is model: no bus, and no plant in another process that would take its part of the processors."""
MEASURED_S: Final = 3.0
_ANSWER_S: Final = 90.0
_DEPTH: Final = 10
_LOOK_S: Final = 0.05
_FOUND_WITHIN_S: Final = 60.0


def subscribers(count: int) -> Point:
    """The cost with so many subscribers to the odometry, each a participant of its own, all in one other process.

    Raises:
        ProcessFailedError: A process ended with an error.
        RigError: Not every subscriber received from the robot.
    """
    with _side_by_side(1) as (folder, (robot,), environment), contextlib.ExitStack() as stack:
        if count:
            words, messages = ["/growth0", str(count)], folder / "listeners.txt"
            listening = command(words, messages, environment, module=__name__, listens=True)
            receiving = int(stack.enter_context(listening).ask("listen", _ANSWER_S))
            if receiving != count:
                raise RigError(f"only {receiving} of {count} subscribers received from the robot")
        return _point(Axis.SUBSCRIBERS, count, _measured([robot]))


def robots(count: int) -> Point:
    """The cost of each of so many robots that run at once, in one ROS domain.

    Raises:
        ProcessFailedError: One of them ended with an error.
    """
    with _side_by_side(count) as (_, running, _):
        return _point(Axis.ROBOTS, count, _measured(running))


@contextlib.contextmanager
def _side_by_side(count: int) -> Iterator[tuple[Path, list[Command], dict[str, str]]]:
    """So many robots that run, each in a namespace of its own, and nobody else in their ROS domain."""
    environment = own_ros_domain()
    with tempfile.TemporaryDirectory(prefix="segway-ecc-growth-") as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        running = []
        for i in range(count):
            words, messages = [ROBOT, "--namespace", f"/growth{i}", "--log"], folder / f"robot{i}.txt"
            words.append(str(folder / f"robot{i}.mcap"))
            started = command(words, messages, environment, module="segway_ecc.hil.growth.robot", listens=True)
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


def listen(namespace: str, count: int) -> None:
    """Receive and discard until standard input ends."""
    kind = message_type("nav_msgs/msg/Odometry")
    with contextlib.ExitStack() as stack:
        nodes = [stack.enter_context(ros_node(f"listener{i}", namespace)) for i in range(count)]
        everyone = [node.create_subscription(kind, "odom", lambda _message: None, _DEPTH) for node in nodes]
        sys.stdin.readline()
        waiting, give_up_s = everyone, time.monotonic() + _FOUND_WITHIN_S
        while waiting and time.monotonic() < give_up_s:
            waiting = [subscription for subscription in waiting if not _take_message(subscription)]
            time.sleep(_LOOK_S)
        sys.stdout.write(f"{len(everyone) - len(waiting)}\n")
        sys.stdout.flush()
        while not select.select([sys.stdin], [], [], _LOOK_S)[0]:
            for subscription in everyone:
                while _take_message(subscription):
                    pass


def _take_message(subscription: RosObject) -> bool:
    return subscription.handle.take_message(subscription.msg_type, False) is not None  # noqa: FBT003 - not raw


if __name__ == "__main__":
    listen(sys.argv[1], int(sys.argv[2]))
