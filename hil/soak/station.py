# SPDX-License-Identifier: MIT
"""Drives a robot over ROS during a soak, in a process of its own: arguments NAMESPACE DURATION.

Publishes set-points and heartbeats as a base station does, and subscribes to what the robot publishes: a robot without
subscribers proves little.
"""

import itertools
import sys
import time
from typing import Final

import msgspec

from segway_ecc.hil.endurance.driving import Driver
from segway_ecc.node.ros.messages import RosObject, message_type, newest_only
from segway_ecc.node.ros.runtime import ros_node

_PERIOD_S: Final = 0.05
_BEAT_EVERY: Final = 5
_DEPTH: Final = 100
_ASK_EVERY_S: Final = 1.0
_TOPICS: Final = {
    "odom": "nav_msgs/msg/Odometry",
    "joint_states": "sensor_msgs/msg/JointState",
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}


class StationCounts(msgspec.Struct):
    """What came of a drive.

    Attributes:
        setpoints: Set-points sent.
        messages: Messages received, by topic.
        modes: Messages of the topic `mode`, by mode and reason.
    """

    setpoints: int
    messages: dict[str, int]
    modes: dict[str, int]


def drive(namespace: str, duration_s: float, seed: int = 1) -> StationCounts:
    """Drive the robot in a namespace for some time."""
    counts = StationCounts(0, dict.fromkeys(_TOPICS, 0), {})
    with ros_node("soak", namespace) as node:
        subscriptions = {
            topic: node.create_subscription(message_type(kind), topic, _never_called, _DEPTH)
            for topic, kind in _TOPICS.items()
        }
        mode_type = message_type("diagnostic_msgs/msg/DiagnosticStatus")
        mode = node.create_subscription(mode_type, "mode", _never_called, _DEPTH)
        publish, operate = _SetpointPublisher(node, seed), _FaultClearer(node)
        begun_s = time.monotonic()
        for turn in itertools.count():
            if turn * _PERIOD_S >= duration_s:
                return counts
            time.sleep(max(begun_s + turn * _PERIOD_S - time.monotonic(), 0.0))
            publish(turn)
            counts.setpoints += 1
            for topic, subscription in subscriptions.items():
                counts.messages[topic] += sum(1 for _ in iter(lambda: _taken(subscription), None))  # noqa: B023 - at once
            for message in iter(lambda: _taken(mode), None):
                counts.modes[message.message] = counts.modes.get(message.message, 0) + 1
                operate(message.message)
    return counts


class _SetpointPublisher:
    """Publishes the set-point of each turn, and heartbeats."""

    def __init__(self, node: RosObject, seed: int) -> None:
        self._driver = Driver(seed)
        self._twist = message_type("geometry_msgs/msg/Twist")
        self._header = message_type("std_msgs/msg/Header")
        self._setpoints = node.create_publisher(self._twist, "cmd_vel", 10)
        self._beats = node.create_publisher(self._header, "station", newest_only())

    def __call__(self, turn: int) -> None:
        message = self._twist()
        message.linear.x, message.angular.z = self._driver.setpoint(turn * _PERIOD_S)
        self._setpoints.publish(message)
        if turn % _BEAT_EVERY == 0:
            beat = self._header(frame_id="soak")
            beat.stamp.sec, beat.stamp.nanosec = divmod(time.monotonic_ns(), 1_000_000_000)
            self._beats.publish(beat)


class _FaultClearer:
    """Clears the fault of a robot that has tripped, and arms it again, as people do; its answers are not waited for."""

    def __init__(self, node: RosObject) -> None:
        trigger = message_type("std_srvs/srv/Trigger")
        self._request = trigger.Request
        self._clients = {word: node.create_client(trigger, f"model/{word}") for word in ("clear_fault", "arm")}
        self._asked_s = 0.0

    def __call__(self, mode: str) -> None:
        action = {"FAULT": "clear_fault", "DISARMED": "arm"}.get(mode.partition(":")[0])
        if action is None or time.monotonic() - self._asked_s < _ASK_EVERY_S:
            return
        self._asked_s = time.monotonic()
        client = self._clients[action]
        client.remove_pending_request(client.call_async(self._request()))


def _taken(subscription: RosObject) -> RosObject:
    taken = subscription.handle.take_message(subscription.msg_type, False)  # noqa: FBT003 - rclpy's signature: not raw
    return None if taken is None else taken[0]


def _never_called(*_: RosObject) -> None:
    """Stand in for the callbacks that only an executor would call."""


if __name__ == "__main__":
    sys.stdout.write(msgspec.json.encode(drive(sys.argv[1], float(sys.argv[2]))).decode() + "\n")
