# SPDX-License-Identifier: MIT
"""A whole manoeuvre in ROS: `cmd_trajectory` on its way to the robot, and `trajectory_status` on the way back."""

import math
import struct
from typing import Final

from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.cycle.trajectory import (
    MOST_POINTS,
    TimedSetpoint,
    Trajectory,
    TrajectoryState,
    TrajectoryStatus,
)
from segway_ecc.node.errors import shortened
from segway_ecc.node.ros.messages import NS_PER_S, RosObject, decode_message, message_type, set_stamp, stamp_ns

TRAJECTORY_TOPIC: Final = "cmd_trajectory"
TRAJECTORY_TYPE: Final = "trajectory_msgs/msg/MultiDOFJointTrajectory"
STATUS_TOPIC: Final = "trajectory_status"
STATUS_TYPE: Final = "diagnostic_msgs/msg/DiagnosticStatus"
STATUS_DEPTH: Final = 10
_BASE_FRAME: Final = "base_link"
"""By REP-105."""
_ENCAPSULATION: Final = 4
_POINT_BYTES: Final = (8 + 7 * 8) + 2 * (8 + 6 * 8) + 8
"""One with transform, velocity, acceleration (each after its count) and time."""
_LARGEST_BYTES: Final = MOST_POINTS * _POINT_BYTES + 4096
"""The rest is room for the names of frame and joints."""


def trajectory_message(trajectory: Trajectory) -> RosObject:
    """A trajectory_msgs/MultiDOFJointTrajectory; velocities are those of the robot's base, in its own frame."""
    message, kind = message_type(TRAJECTORY_TYPE)(), message_type("trajectory_msgs/msg/MultiDOFJointTrajectoryPoint")
    twist_kind = message_type("geometry_msgs/msg/Twist")
    set_stamp(message.header, trajectory.stamp_ns)
    message.header.frame_id = _BASE_FRAME
    message.joint_names = [_BASE_FRAME]
    for offset_ns, setpoint in trajectory.points:
        point, twist = kind(), twist_kind()
        twist.linear.x, twist.angular.z = setpoint
        point.velocities = [twist]
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(offset_ns, NS_PER_S)
        message.points.append(point)
    return message


def read_trajectory(data: bytes, base_frame: str = _BASE_FRAME) -> Trajectory:
    """What a trajectory_msgs/MultiDOFJointTrajectory asks of the base of a robot, from the bytes that DDS carries.

    What it asks for beyond one velocity of the base at a time is named, for which the loop refuses the whole. A message
    that is too large is not decoded: rclpy would take seconds. It gets so many points that it is refused for that.

    Raises:
        RuntimeError: They are no such message.
    """
    if len(data) > _LARGEST_BYTES:
        sec, nanosec = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, _ENCAPSULATION)
        return Trajectory(sec * NS_PER_S + nanosec, (TimedSetpoint(0, REST),) * (MOST_POINTS + 1))
    message = decode_message(data, message_type(TRAJECTORY_TYPE))
    points = []
    for point in message.points[: MOST_POINTS + 1]:
        offset_ns = point.time_from_start.sec * NS_PER_S + point.time_from_start.nanosec
        velocities = [Setpoint(twist.linear.x, twist.angular.z) for twist in point.velocities[:1]]
        points.append(TimedSetpoint(offset_ns, velocities[0] if velocities else Setpoint(math.nan, math.nan)))
    return Trajectory(stamp_ns(message.header), tuple(points), _unsupported(message, base_frame) if points else "")


def _unsupported(message: RosObject, base_frame: str) -> str:
    frames = {_BASE_FRAME, base_frame}
    if message.header.frame_id not in {"", *frames}:
        return f"header.frame_id is not {base_frame}, the frame of its velocities"
    if len(message.joint_names) != 1 or message.joint_names[0] not in frames:
        return f"joint_names is not [{base_frame}], which is all that it moves"
    for place, point in enumerate(message.points[:MOST_POINTS]):
        if len(point.velocities) != 1:
            return f"point {place} has {len(point.velocities)} velocities and needs one"
        if len(point.transforms) or len(point.accelerations):
            return f"point {place} has transforms or accelerations, which it does not follow"
        linear, angular = point.velocities[0].linear, point.velocities[0].angular
        if any((linear.y, linear.z, angular.x, angular.y)):
            return f"point {place} asks for a velocity other than linear.x and angular.z"
    return ""


def read_status(message: RosObject) -> TrajectoryStatus | None:
    """What became of a trajectory, from a message on `trajectory_status`; None where the message does not tell."""
    values = {pair.key: pair.value for pair in message.values}
    try:
        return TrajectoryStatus(
            int(values["stamp_ns"]),
            TrajectoryState(values["state"]),
            shortened(values["reason"]),
            int(values["start_ns"]),
            int(values["end_ns"]),
            int(values["cycles"]),
            int(values["digest"]),
        )
    except (KeyError, ValueError):
        return None
