# SPDX-License-Identifier: MIT
"""Sequence control by somebody else, at the far end of a network: says set-points and hears when each came into force.

For each line on standard input, `{"seconds": S, "stamped": bool}`, it says ten set-points a second for so long, each of
another velocity, and answers with one line: for each of them when it was said, what for, and the robot's stamp of the
cycle in which it came into force; ns, null where it did not. Both ends have one clock, that of the kernel.
"""

import json
import sys
import time
from typing import Any

import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile

PERIOD_NS = 100_000_000
LEAD_NS = 500_000_000
NS_PER_S = 1_000_000_000
ECHOED_WITHIN_NS = 3 * NS_PER_S
STEP = 0.001


class Station:
    """The node, its publishers, and what it heard."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("foreign_sequence")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.plain = self.node.create_publisher(Twist, "cmd_vel", 10)
        self.stamped = self.node.create_publisher(TwistStamped, "cmd_vel_stamped", 1000)
        self.applied: dict[int, int] = {}
        """Stamp of the cycle in which each came into force."""
        self.number = 0
        self.node.create_subscription(TwistStamped, "setpoint", self.hear, QoSProfile(depth=1000))

    def hear(self, message: Any) -> None:
        stamp = message.header.stamp
        number = round(message.twist.linear.x / STEP)
        self.applied.setdefault(number, stamp.sec * NS_PER_S + stamp.nanosec)

    def wait(self) -> None:
        """Until both ends see each other: a set-point of ours has come into force."""
        while not self.applied:
            self.say(None)
            self.spin_until(time.time_ns() + PERIOD_NS)

    def say(self, for_ns: int | None) -> int:
        self.number += 1
        if for_ns is None:
            message = Twist()
            message.linear.x = self.number * STEP
            self.plain.publish(message)
        else:
            message = TwistStamped()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(for_ns, NS_PER_S)
            message.twist.linear.x = self.number * STEP
            self.stamped.publish(message)
        return self.number

    def spin_until(self, until_ns: int) -> None:
        while (left_ns := until_ns - time.time_ns()) > 0:
            self.executor.spin_once(min(left_ns / NS_PER_S, 0.02))

    def play(self, seconds: float, *, stamped: bool) -> list[list[int | None]]:
        start_ns, said = time.time_ns(), []
        for place in range(round(seconds * NS_PER_S / PERIOD_NS)):
            now_ns = time.time_ns()
            for_ns = start_ns + place * PERIOD_NS + LEAD_NS if stamped else None
            said.append((self.say(for_ns), now_ns, for_ns))
            self.spin_until(start_ns + (place + 1) * PERIOD_NS)
        self.spin_until(time.time_ns() + ECHOED_WITHIN_NS)
        return [[now_ns, for_ns, self.applied.get(number)] for number, now_ns, for_ns in said]


def main() -> None:
    rclpy.init()
    station = Station()
    station.wait()
    for line in sys.stdin:
        asked = json.loads(line)
        sys.stdout.write(json.dumps(station.play(asked["seconds"], stamped=asked["stamped"])) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
