# SPDX-License-Identifier: MIT
"""Bytes that ROS itself must read as what was filled in."""

import importlib
import itertools
import math
from typing import Any

import pytest

from segway_ecc.node.ros.messages import STAMP, Template, message_type

pytestmark = pytest.mark.ros


def read(raw: bytes, kind: type) -> Any:
    return importlib.import_module("rclpy.serialization").deserialize_message(raw, kind)


def test_ros_reads_what_was_filled_in_and_what_stays() -> None:
    kind = message_type("nav_msgs/msg/Odometry")
    message = kind()
    message.header.frame_id, message.child_frame_id = "odom", "base_link"
    message.pose.covariance[3] = 7.0
    template = Template(message, *STAMP, ("pose.pose.position.y", "d"), ("twist.twist.angular.z", "d"))

    filled = read(template.filled(-5, 999_999_999, math.inf, -0.1), kind)

    message.header.stamp.sec, message.header.stamp.nanosec = -5, 999_999_999
    message.pose.pose.position.y, message.twist.twist.angular.z = math.inf, -0.1
    assert filled == message


def test_each_filling_is_of_its_own_and_the_message_keeps_its_values() -> None:
    kind = message_type("geometry_msgs/msg/Point")
    message = kind(x=1.0, y=2.0, z=3.0)
    template = Template(message, ("x", "d"), ("z", "d"))
    first, second = template.filled(4.0, 5.0), template.filled(6.0, math.nan)
    assert read(first, kind) == kind(x=4.0, y=2.0, z=5.0)
    assert math.isnan(read(second, kind).z)
    assert message == kind(x=1.0, y=2.0, z=3.0)


def test_places_in_sequences_of_a_known_length() -> None:
    kind = message_type("sensor_msgs/msg/JointState")
    message = kind(name=["a", "bcd"], position=[0.0, 0.0])
    filled = read(Template(message, ("position.0", "d"), ("position.1", "d")).filled(1.0, 2.0), kind)
    assert (list(filled.name), list(filled.position), list(filled.velocity)) == (["a", "bcd"], [1.0, 2.0], [])


def test_what_aligns_the_fields_may_differ_from_time_to_time(monkeypatch: pytest.MonkeyPatch) -> None:
    serialization, times = importlib.import_module("rclpy.serialization"), itertools.count(1)
    serialize = serialization.serialize_message

    def with_any_bytes_between(message: Any) -> bytes:
        raw = bytearray(serialize(message))
        raw[17] = next(times)  # behind the frame's empty name, which takes five bytes of eight
        return bytes(raw)

    monkeypatch.setattr(serialization, "serialize_message", with_any_bytes_between)
    kind = message_type("sensor_msgs/msg/JointState")
    filled = read(Template(kind(position=[0.0]), ("position.0", "d")).filled(1.5), kind)
    assert list(filled.position) == [1.5]


def test_too_few_values_are_refused() -> None:
    template = Template(message_type("geometry_msgs/msg/Point")(), ("x", "d"), ("y", "d"))
    with pytest.raises(ValueError, match="shorter"):
        template.filled(1.0)


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ([("y", "d"), ("x", "d")], "x comes before another field"),
        ([("x", "f")], "x is no number of the format 'f'"),
    ],
)
def test_fields_that_are_not_there_are_refused(fields: list[tuple[str, str]], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        Template(message_type("geometry_msgs/msg/Point")(), *fields)
