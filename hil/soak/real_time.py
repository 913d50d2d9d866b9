# SPDX-License-Identifier: MIT
"""A robot in real time: the node with ROS and its recorder, a plant, and a station that drives it.

As a program, that station: arguments NAMESPACE DURATION. It publishes set-points and heartbeats as a base station does,
and subscribes to what the robot publishes: a robot without subscribers proves little. It prints, as JSON, how many
messages of the topic `mode` arrived, by mode and reason.
"""

import contextlib
import math
import os
import sys
import time
from collections.abc import Callable
from typing import Any, Final

import msgspec

from segway_ecc.hil.endurance.driving import Driver
from segway_ecc.hil.process_usage import helpers_of
from segway_ecc.hil.processes import command, own_ros_domain
from segway_ecc.hil.progress import OnSeconds
from segway_ecc.hil.soak.watching import LOG, Watching
from segway_ecc.node.recording.log_quota import MB
from segway_ecc.node.ros.messages import RosObject, message_type, newest_only
from segway_ecc.node.ros.runtime import ros_node

_SETTLE_S: Final = 3.0
_END_S: Final = 60.0
_PERIOD_S: Final = 0.05
_BEAT_EVERY: Final = 5
_DEPTH: Final = 100
_ASK_EVERY_S: Final = 1.0
_TOPICS: Final = {
    "odom": "nav_msgs/msg/Odometry",
    "joint_states": "sensor_msgs/msg/JointState",
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}


class RealTimeSoak(msgspec.Struct, frozen=True):
    """What is run: a robot file, how long, s, looked at how often, s, and whether with ROS."""

    robot: str
    duration_s: float
    every_s: float
    ros: bool


class RealTimeResult(msgspec.Struct, frozen=True):
    """What the node reports of its run, and messages of the topic `mode`, by mode and reason: none without ROS."""

    node: dict[str, Any]
    modes: dict[str, int]


def soak(run: RealTimeSoak, watching: Watching, on_progress: OnSeconds) -> RealTimeResult:
    """Run a robot for some time, and look at its processes every few seconds.

    Raises:
        ProcessFailedError: One of the processes ended with an error.
    """
    folder = watching.folder
    line = ["--channel", f"soak_{os.getpid()}", "--interface", "local"]
    namespace = f"/soak_{os.getpid()}"
    alone = own_ros_domain()  # what DDS keeps of the neighbours' participants is not the robot's growth
    node = ["run", run.robot, *line, "--duration", str(run.duration_s), "--json", "--log", str(folder / "soak.mcap")]
    node += ["--log-limit", str(LOG.total_bytes / MB), "--log-file-size", str(LOG.file_bytes / MB)]
    node += ["--namespace", namespace] if run.ros else ["--no-ros"]
    with contextlib.ExitStack() as stack:
        plant = stack.enter_context(command(["plant", run.robot, *line], folder / "plant.txt"))
        controller = stack.enter_context(command(node, folder / "node.txt", alone))
        processes = {"node": controller.process.pid, "plant": plant.process.pid}
        if run.ros:
            words = [namespace, str(run.duration_s - _SETTLE_S)]
            station = stack.enter_context(command(words, folder / "station.txt", alone, module=__name__))
            processes["station"] = station.process.pid
        begun_s, turn = time.monotonic(), 1
        while turn * run.every_s < run.duration_s - _SETTLE_S:
            time.sleep(max(begun_s + turn * run.every_s - time.monotonic(), 0.0))
            processes |= helpers_of(processes["node"])
            watching.look(time.monotonic() - begun_s, processes)
            on_progress(time.monotonic() - begun_s)
            turn += 1
        return RealTimeResult(controller.result(_END_S), station.result(_END_S) if run.ros else {})


def drive(namespace: str, duration_s: float) -> dict[str, int]:
    """Drive the robot in a namespace for some time; returns the messages of its mode, by mode and reason."""
    modes: dict[str, int] = {}
    with ros_node("soak", namespace) as node:

        def subscribed(topic: str, kind: str) -> RosObject:
            # Only an executor would call back.
            return node.create_subscription(message_type(kind), topic, lambda _message: None, _DEPTH)

        subscriptions = [subscribed(topic, kind) for topic, kind in _TOPICS.items()]
        mode = subscribed("mode", "diagnostic_msgs/msg/DiagnosticStatus")
        publish, operate = _setpoint_publisher(node), _FaultClearer(node)
        begun_s = time.monotonic()
        for turn in range(math.ceil(duration_s / _PERIOD_S)):
            time.sleep(max(begun_s + turn * _PERIOD_S - time.monotonic(), 0.0))
            publish(turn)
            for subscription in subscriptions:
                while _taken(subscription) is not None:
                    pass
            for message in iter(lambda: _taken(mode), None):
                modes[message.message] = modes.get(message.message, 0) + 1
                operate(message.message)
    return modes


def _setpoint_publisher(node: RosObject) -> Callable[[int], None]:
    """Publishes the set-point of each turn, and heartbeats."""
    driver, twist, header = Driver(1), message_type("geometry_msgs/msg/Twist"), message_type("std_msgs/msg/Header")
    setpoints = node.create_publisher(twist, "cmd_vel", 10)
    beats = node.create_publisher(header, "station", newest_only())

    def publish(turn: int) -> None:
        message = twist()
        message.linear.x, message.angular.z = driver.setpoint(turn * _PERIOD_S)
        setpoints.publish(message)
        if turn % _BEAT_EVERY == 0:
            beat = header(frame_id="soak")
            beat.stamp.sec, beat.stamp.nanosec = divmod(time.monotonic_ns(), 1_000_000_000)
            beats.publish(beat)

    return publish


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


if __name__ == "__main__":
    sys.stdout.write(msgspec.json.encode(drive(sys.argv[1], float(sys.argv[2]))).decode() + "\n")
