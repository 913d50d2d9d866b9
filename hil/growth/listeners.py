# SPDX-License-Identifier: MIT
"""Subscribers to the odometry, each a ROS participant of its own: arguments NAMESPACE COUNT.

For the first line on its standard input it answers how many of them have received from the robot, once all have; then
it listens until its standard input ends.
"""

import contextlib
import select
import sys
import time
from typing import Final

from segway_ecc.node.ros.messages import RosObject, message_type
from segway_ecc.node.ros.runtime import ros_node

_DEPTH: Final = 10
_LOOK_S: Final = 0.05
_FOUND_WITHIN_S: Final = 60.0


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
    """Take a message, if there is one."""
    return subscription.handle.take_message(subscription.msg_type, False) is not None  # noqa: FBT003 - not raw


if __name__ == "__main__":
    listen(sys.argv[1], int(sys.argv[2]))
