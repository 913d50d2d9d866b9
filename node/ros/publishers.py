"""The topics that tell the world of each cycle."""

import math
from collections.abc import Callable, Sequence
from typing import Final

from node.config import RosSection
from node.cycle.wiring import IMU_SIGNALS, JOINT_SIGNALS, ODOMETRY_SIGNALS, SUPPLY_SIGNAL
from node.ros.messages import message_type, set_heading, set_stamp
from node.ros.untyped import RosObject

Publish = Callable[[int, Sequence[float]], None]
"""Called with the stamp, ns since the Unix epoch, and the published signals."""

_DEPTH: Final = 10
_SCALARS: Final = {
    "linear_velocity": "odometry.linear_velocity",
    "angular_velocity": "odometry.angular_velocity",
}
_BATTERY_PERIOD_NS: Final = 500_000_000
_NOT_MEASURED: Final = -1.0
"""Where a covariance begins with it, the message does not carry what it belongs to (sensor_msgs/Imu)."""


def make_publishers(node: RosObject, ros: RosSection, signals: Sequence[str]) -> list[Publish]:
    """One callable per topic that these signals suffice for. Messages are made once and filled anew each cycle.

    What was measured too long ago is not published: silence is true, and an old value under a new stamp is not.
    """
    index = {signal: position for position, signal in enumerate(signals)}
    publishers = [_scalar(node, topic, index[signal]) for topic, signal in _SCALARS.items() if signal in index]
    if all(signal in index for signal in ODOMETRY_SIGNALS):
        publishers.append(_position(node, index["odometry.x"], index["odometry.y"]))
        publishers.append(_odometry(node, ros, [index[signal] for signal in ODOMETRY_SIGNALS]))
    if all(signal in index for signal in JOINT_SIGNALS):
        publishers.append(_joint_states(node, ros, [index[signal] for signal in JOINT_SIGNALS]))
    if all(signal in index for signal in IMU_SIGNALS):
        publishers.append(_imu(node, ros, [index[signal] for signal in IMU_SIGNALS]))
    if SUPPLY_SIGNAL in index:
        publishers.append(_battery(node, ros, index[SUPPLY_SIGNAL]))
    return publishers


def make_scalar_publishers(node: RosObject, topics: Sequence[str]) -> list[Callable[[float], None]]:
    """One callable per topic of type std_msgs/Float64."""
    return [_number(node, topic.replace(".", "/")) for topic in topics]


def _number(node: RosObject, topic: str) -> Callable[[float], None]:
    kind = message_type("std_msgs/msg/Float64")
    message, publisher = kind(), node.create_publisher(kind, topic, _DEPTH)

    def publish(value: float) -> None:
        message.data = value
        publisher.publish(message)

    return publish


def _scalar(node: RosObject, topic: str, index: int) -> Publish:
    publish_number = _number(node, topic)

    def publish(_stamp_ns: int, values: Sequence[float]) -> None:
        publish_number(values[index])

    return publish


def _position(node: RosObject, x: int, y: int) -> Publish:
    kind = message_type("geometry_msgs/msg/Point")
    message, publisher = kind(), node.create_publisher(kind, "position", _DEPTH)

    def publish(_stamp_ns: int, values: Sequence[float]) -> None:
        message.x, message.y = values[x], values[y]
        publisher.publish(message)

    return publish


def _odometry(node: RosObject, ros: RosSection, indices: Sequence[int]) -> Publish:
    kind = message_type("nav_msgs/msg/Odometry")
    message, publisher = kind(), node.create_publisher(kind, "odom", _DEPTH)
    message.header.frame_id, message.child_frame_id = ros.odometry_frame, ros.base_frame
    pose, twist = message.pose.pose, message.twist.twist

    def publish(stamp_ns: int, values: Sequence[float]) -> None:
        x, y, heading, linear, angular = (values[index] for index in indices)
        set_stamp(message.header, stamp_ns)
        pose.position.x, pose.position.y = x, y
        set_heading(pose.orientation, heading)
        twist.linear.x, twist.angular.z = linear, angular
        publisher.publish(message)

    return publish


def _joint_states(node: RosObject, ros: RosSection, indices: Sequence[int]) -> Publish:
    kind = message_type("sensor_msgs/msg/JointState")
    message, publisher = kind(), node.create_publisher(kind, "joint_states", _DEPTH)
    message.name = [ros.left_joint, ros.right_joint]

    def publish(stamp_ns: int, values: Sequence[float]) -> None:
        left, right, left_velocity, right_velocity = measured = [values[index] for index in indices]
        if not all(map(math.isfinite, measured)):
            return
        set_stamp(message.header, stamp_ns)
        message.position, message.velocity = [left, right], [left_velocity, right_velocity]
        publisher.publish(message)

    return publish


def _imu(node: RosObject, ros: RosSection, indices: Sequence[int]) -> Publish:
    kind = message_type("sensor_msgs/msg/Imu")
    message, publisher = kind(), node.create_publisher(kind, "imu/data", _DEPTH)
    message.header.frame_id = ros.imu_frame
    message.orientation_covariance[0] = _NOT_MEASURED
    rate, force = message.angular_velocity, message.linear_acceleration

    def publish(stamp_ns: int, values: Sequence[float]) -> None:
        rate.x, rate.y, rate.z, force.x, force.y, force.z = measured = [values[index] for index in indices]
        if not all(map(math.isfinite, measured)):
            return
        set_stamp(message.header, stamp_ns)
        publisher.publish(message)

    return publish


def _battery(node: RosObject, ros: RosSection, index: int) -> Publish:
    """The supply's voltage, twice a second by the stamps: what a base station shows needs no more."""
    kind = message_type("sensor_msgs/msg/BatteryState")
    message, publisher = kind(), node.create_publisher(kind, "battery_state", _DEPTH)
    message.header.frame_id = ros.base_frame
    message.present = True
    # Not measured, as the message wants it told; how it is charged and of what kind it is stays "unknown".
    message.temperature = message.current = message.charge = math.nan
    message.capacity = message.design_capacity = message.percentage = math.nan
    told = -1

    def publish(stamp_ns: int, values: Sequence[float]) -> None:
        nonlocal told
        turn = stamp_ns // _BATTERY_PERIOD_NS
        if turn == told or not math.isfinite(values[index]):
            return
        told = turn
        set_stamp(message.header, stamp_ns)
        message.voltage = values[index]
        publisher.publish(message)

    return publish
