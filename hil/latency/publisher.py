# SPDX-License-Identifier: MIT
"""Publishes set-points on cmd_vel, and prints when, as JSON: arguments NAMESPACE COUNT PERIOD."""

import sys
import time
from typing import Final

import msgspec

from segway_ecc.hil.latency.result import Timed
from segway_ecc.hil.latency.setpoints import publish_all
from segway_ecc.node.cycle.real_time import real_time_priority
from segway_ecc.node.errors import NobodyListensError
from segway_ecc.node.ros.messages import message_type
from segway_ecc.node.ros.runtime import ros_node

_FOUND_WITHIN_S: Final = 240.0
"""In an emulated machine the robot takes minutes to start."""
_LOOK_S: Final = 0.05
_LAST_S: Final = 0.5
"""The last one is to arrive too, while somebody still looks."""
_BOTH_WAYS_S: Final = 1.0
"""That we see its subscription does not mean that the robot sees us: discovery goes each way on its own."""


def publish(namespace: str, count: int, period_s: float) -> list[Timed]:
    """Publish so many set-points to the robot in a namespace, once it is found.

    Raises:
        NobodyListensError: It was not found.
    """
    with ros_node("latency", namespace) as node:
        kind = message_type("geometry_msgs/msg/Twist")
        publisher = node.create_publisher(kind, "cmd_vel", 10)
        message = kind()

        def send(velocity: float) -> None:
            message.linear.x = velocity
            publisher.publish(message)

        give_up_s = time.monotonic() + _FOUND_WITHIN_S
        while publisher.get_subscription_count() == 0:
            if time.monotonic() > give_up_s:
                raise NobodyListensError(f"no robot took {publisher.topic_name} within {_FOUND_WITHIN_S:g} s")
            time.sleep(_LOOK_S)
        time.sleep(_BOTH_WAYS_S)
        with real_time_priority():  # nothing of other programs between a time that is noted and what is published then
            published = publish_all(count, period_s, send)
        time.sleep(_LAST_S)
        return published


if __name__ == "__main__":
    found = publish(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]))
    sys.stdout.write(msgspec.json.encode(found).decode() + "\n")
