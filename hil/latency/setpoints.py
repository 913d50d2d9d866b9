# SPDX-License-Identifier: MIT
"""The set-points of a measurement: who publishes them, and the model that gives them to a motor.

As a program, publishes them on cmd_vel, and prints when, as JSON: arguments NAMESPACE COUNT PERIOD.
"""

import random
import sys
import time
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import msgspec

from segway_ecc.node.cycle.real_time import real_time_priority
from segway_ecc.node.errors import NobodyListensError
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.ros.messages import message_type
from segway_ecc.node.ros.runtime import ros_node

STEP: Final = 0.001
"""Set-points differ by this, m/s: one count of the wheel board's voltage, V."""
MOST: Final = 9000
_LEAST_PERIODS: Final = 2.0
_MORE_PERIODS: Final = 1.0
_FOUND_WITHIN_S: Final = 240.0
"""In an emulated machine the robot takes minutes to start."""
_LOOK_S: Final = 0.05
_LAST_S: Final = 0.5
"""The last one is to arrive too, while somebody still looks."""
_BOTH_WAYS_S: Final = 1.0
"""That we see its subscription does not mean that the robot sees us: discovery goes each way on its own."""


class Echo(SectionedModel):
    """Gives its set-point to the motors, so that a motor frame shows which set-point it was made from.

    The voltage of either motor, V, is the forward velocity that was asked for, m/s.
    """

    name = "echo"
    step_size = 0.01
    method = Method.DISCRETE
    inputs = (Variable("Setpoint", "m/s"),)
    outputs = (Variable("Left", "V"), Variable("Right", "V"))

    def input(self, u: Sequence[float]) -> None:
        """Take the set-point."""
        (self.setpoint,) = u

    def output(self) -> Sequence[float]:
        """Hand it on."""
        return self.setpoint, self.setpoint


class Timed(NamedTuple):
    """The number of a set-point, and when it was published or seen, ns, monotonic."""

    number: int
    at_ns: int


def publish_all(count: int, period_s: float, send: Callable[[float], None]) -> list[Timed]:
    """Publish so many set-points at random phases of the loop, two to three periods apart: none overtakes another.

    There are up to `MOST`, each another number, its time noted before `send` publishes it, m/s.
    """
    chance = random.Random(1)  # noqa: S311 - chance that can be repeated is what is wanted
    published = []
    for number in range(1, count + 1):
        time.sleep(period_s * (_LEAST_PERIODS + _MORE_PERIODS * chance.random()))
        published.append(Timed(number, time.monotonic_ns()))
        send(number * STEP)
    return published


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
