# SPDX-License-Identifier: MIT
"""What the station takes from a robot's topics, with a node that only hands out bytes."""

import importlib
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from segway_ecc.deploy.station.robot_messages import Health, ModeReport
from segway_ecc.deploy.station.ros_bridge import RosRobotConnection
from segway_ecc.node.cycle.setpoints import Setpoint

pytestmark = pytest.mark.ros


class Robot:
    """A node whose subscriptions hold what was put on their topics."""

    def __init__(self) -> None:
        self._arrived: dict[str, list[bytes]] = {}
        node = MagicMock()
        node.create_subscription = self._subscribe
        self.connection = RosRobotConnection(node, "/alice", "model")

    def put(self, topic: str, message: Any) -> None:
        self._arrived[topic].append(importlib.import_module("rclpy.serialization").serialize_message(message))

    def received(self) -> list[type]:
        return [type(message) for message, _ in self.connection.received(everything=True)]

    def _subscribe(self, kind: type, topic: str, *_: Any) -> SimpleNamespace:
        data = self._arrived[topic.removeprefix("/alice/")] = []

        def take(_kind: type, raw: bool) -> Any:  # noqa: FBT001 - rclpy's signature
            assert raw, f"rclpy decodes all of {topic} before anybody sees how large it is"
            return (data.pop(0), {"received_timestamp": 1}) if data else None

        return SimpleNamespace(handle=SimpleNamespace(take_message=take), msg_type=kind)


@pytest.fixture
def robot() -> Robot:
    return Robot()


def diagnostic_status(pairs: int) -> Any:
    kind = importlib.import_module("diagnostic_msgs.msg")
    first = kind.KeyValue(key="mode", value="ARMED")
    return kind.DiagnosticStatus(name="alice: mode", values=[first] + [kind.KeyValue()] * pairs)


def test_messages_are_decoded(robot: Robot) -> None:
    robot.put("mode", diagnostic_status(10))
    robot.put("diagnostics", importlib.import_module("diagnostic_msgs.msg").DiagnosticArray())
    assert robot.received() == [ModeReport, Health]
    assert robot.connection.refused == 0


@pytest.mark.parametrize("topic", ["mode", "trajectory_status", "diagnostics"])
def test_a_message_that_is_too_large_is_refused_and_counted_before_it_is_decoded(
    robot: Robot, topic: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    message = diagnostic_status(100_000)
    if topic == "diagnostics":
        message = importlib.import_module("diagnostic_msgs.msg").DiagnosticArray(status=[message])
    robot.put(topic, message)
    monkeypatch.setattr("rclpy.serialization.deserialize_message", None)
    assert robot.received() == []
    assert robot.connection.refused == 1


def test_bytes_that_are_no_message_are_refused_and_counted(robot: Robot) -> None:
    robot.put("mode", importlib.import_module("std_msgs.msg").Float64(data=1.0))
    assert robot.received() == []
    assert robot.connection.refused == 1


class Publisher:
    """Remembers what was published."""

    def __init__(self, kind: type, topic: str) -> None:
        self.msg_type, self.topic = kind, topic
        self.sent: list[Any] = []
        self.publish = self.sent.append

    def get_subscription_count(self) -> int:
        return 0


@pytest.mark.parametrize("is_known_at_first", [True, False])
@pytest.mark.parametrize("kind", ["Twist", "TwistStamped"])
def test_a_robot_is_driven_by_the_type_that_it_takes(kind: str, *, is_known_at_first: bool) -> None:
    made: list[Publisher] = []
    takers = [SimpleNamespace(topic_type=f"geometry_msgs/msg/{kind}")]
    node = MagicMock()

    def create_publisher(of: type, topic: str, _depth: int) -> Publisher:
        made.append(Publisher(of, topic))
        return made[-1]

    node.create_publisher = create_publisher
    node.get_subscriptions_info_by_topic.return_value = takers if is_known_at_first else []
    connection = RosRobotConnection(node, "/alice", "model")
    node.get_subscriptions_info_by_topic.return_value = takers
    connection.drive(Setpoint(0.5, -0.25))
    drives = [each for each in made if each.topic == "/alice/cmd_vel"]
    assert len(drives) == 1 + (kind == "TwistStamped" and not is_known_at_first)
    (message,) = drives[-1].sent
    assert type(message).__name__ == kind
    twist = message.twist if kind == "TwistStamped" else message
    assert (twist.linear.x, twist.angular.z) == (0.5, -0.25)
    if kind == "TwistStamped":
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == (0, 0), "now"
