# SPDX-License-Identifier: MIT
"""Against rclpy's own serialization, and against bytes that are none."""

import math
import random
import struct

import pytest

from segway_ecc.deploy.station.robot_messages import read_odometry
from segway_ecc.node.recording import cdr


def message(frames: tuple[str, str] = ("odom", "base_link"), x: float = 1.5) -> bytes:
    pose = cdr.Pose((x, -2.5, 9.0), (0.0, 0.0, math.sin(0.375), math.cos(0.375)), [7.0] * 36)
    twist = cdr.Twist((0.5, 8.0, 8.0), (8.0, 8.0, -0.25), [7.0] * 36)
    return cdr.odometry(1_700_000_000_123_456_789, *frames, pose, twist)


@pytest.mark.parametrize(
    "frames", [("", ""), ("odom", "base_link"), ("o", "b"), ("robot1/odom", "robot1/base"), ("ö", "x")]
)
def test_what_the_recorder_writes_is_read(frames: tuple[str, str]) -> None:
    read = read_odometry(message(frames))
    assert read is not None
    assert read[:3] == (1_700_000_000_123_456_789, 1.5, -2.5)
    assert read[3:] == pytest.approx((0.75, 0.5, -0.25), abs=1e-12)


@pytest.mark.ros
@pytest.mark.parametrize("length", range(9))
def test_what_ros_writes_is_read(length: int) -> None:
    from nav_msgs.msg import Odometry  # noqa: PLC0415 - only where ROS is
    from rclpy.serialization import serialize_message  # noqa: PLC0415 - only where ROS is

    odometry = Odometry()
    odometry.header.frame_id, odometry.child_frame_id = "o" * length, "b" * (3 * length % 8)
    odometry.header.stamp.sec, odometry.header.stamp.nanosec = 17, 999_999_999
    odometry.pose.pose.position.x, odometry.pose.pose.position.y, odometry.pose.pose.position.z = 3.0, 4.0, 99.0
    odometry.pose.pose.orientation.z, odometry.pose.pose.orientation.w = math.sin(1.0), math.cos(1.0)
    odometry.pose.covariance[35] = odometry.twist.covariance[0] = 7.0
    odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = -1.0, 2.0
    odometry.twist.twist.linear.y = odometry.twist.twist.angular.x = 55.0
    assert read_odometry(serialize_message(odometry)) == pytest.approx((17_999_999_999, 3.0, 4.0, 2.0, -1.0, 2.0))


def test_the_other_byte_order_is_read() -> None:
    body = struct.pack(">iI", 1, 2) + 2 * struct.pack(">I4s", 1, b"") + struct.pack(">7d", 1, 2, 3, 0, 0, 0, 1)
    body += bytes(288) + struct.pack(">6d", 5, 0, 0, 0, 0, 6) + bytes(288)
    assert read_odometry(b"\0\0\0\0" + body) == (1_000_000_002, 1.0, 2.0, 0.0, 5.0, 6.0)


@pytest.mark.parametrize("x", [math.nan, math.inf])
def test_what_is_not_finite_is_refused(x: float) -> None:
    assert read_odometry(message(x=x)) is None


def test_a_message_that_ends_early_is_refused_wherever_it_ends() -> None:
    whole = message()
    ends = len(whole) - 288  # the last covariance is not looked at
    assert read_odometry(whole[:ends]) is not None
    assert all(read_odometry(whole[:end]) is None for end in range(ends))


def test_no_bytes_raise() -> None:
    """Ten thousand messages, damaged and cut off anywhere; plain random numbers are drawn faster than examples."""
    draw, whole = random.Random(1), message()  # noqa: S311 - nothing secret
    refused = 0
    for _ in range(10_000):
        at, data = draw.randrange(len(whole)), draw.randbytes(draw.randrange(1, 9))
        read = read_odometry((whole[:at] + data + whole[at + len(data) :])[: draw.randrange(1000)])
        assert read is None or all(map(math.isfinite, read))
        refused += read is None
    assert 1000 < refused < 9000
