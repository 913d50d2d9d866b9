# SPDX-License-Identifier: MIT
"""A whole manoeuvre in ROS: `cmd_trajectory` on its way to the robot, and `trajectory_status` on the way back."""

import math
from typing import Final

from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.trajectory import (
    MOST_POINTS,
    TimedSetpoint,
    Trajectory,
    TrajectoryState,
    TrajectoryStatus,
)
from segway_ecc.node.ros.messages import NS_PER_S, RosObject, message_type, set_stamp, stamp_ns

TRAJECTORY_TOPIC: Final = "cmd_trajectory"
TRAJECTORY_TYPE: Final = "trajectory_msgs/msg/MultiDOFJointTrajectory"
STATUS_TOPIC: Final = "trajectory_status"
STATUS_TYPE: Final = "diagnostic_msgs/msg/DiagnosticStatus"
STATUS_DEPTH: Final = 10
_BASE_FRAME: Final = "base_link"
"""By REP-105."""


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


def read_trajectory(message: RosObject) -> Trajectory:
    """What a trajectory_msgs/MultiDOFJointTrajectory asks of the robot.

    A point without a velocity has one that is not a number, for which the loop refuses the whole. Of a message that is
    too long only so much is read that the loop refuses it for that.
    """
    points = []
    for point in message.points[: MOST_POINTS + 1]:
        offset_ns = point.time_from_start.sec * NS_PER_S + point.time_from_start.nanosec
        velocities = [Setpoint(twist.linear.x, twist.angular.z) for twist in point.velocities[:1]]
        points.append(TimedSetpoint(offset_ns, velocities[0] if velocities else Setpoint(math.nan, math.nan)))
    return Trajectory(stamp_ns(message.header), tuple(points))


def read_status(message: RosObject) -> TrajectoryStatus | None:
    """What became of a trajectory, from a message on `trajectory_status`; None where the message does not tell."""
    values = {pair.key: pair.value for pair in message.values}
    try:
        return TrajectoryStatus(
            int(values["stamp_ns"]),
            TrajectoryState(values["state"]),
            values["reason"],
            int(values["start_ns"]),
            int(values["end_ns"]),
        )
    except (KeyError, ValueError):
        return None
