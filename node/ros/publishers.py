"""The topics that tell the world of each cycle."""

import math
from collections.abc import Callable, Sequence
from typing import Final

from node.cycle.wiring import IMU_SIGNALS, JOINT_SIGNALS, ODOMETRY_SIGNALS, SUPPLY_SIGNAL
from node.ros.messages import NS_PER_S, message_type, set_stamp
from node.ros.section import RosSection
from node.ros.template import STAMP, Template
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
    """One callable per topic that these signals suffice for. A message is made once, its numbers written in each cycle.

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
    publish_bytes, template = node.create_publisher(kind, topic, _DEPTH).publish, Template(kind(), ("data", "d"))

    def publish(value: float) -> None:
        publish_bytes(template.filled(value))

    return publish


def _scalar(node: RosObject, topic: str, index: int) -> Publish:
    publish_number = _number(node, topic)

    def publish(_stamp_ns: int, values: Sequence[float]) -> None:
        publish_number(values[index])

    return publish


def _position(node: RosObject, x: int, y: int) -> Publish:
    kind = message_type("geometry_msgs/msg/Point")
    template = Template(kind(), ("x", "d"), ("y", "d"))
    publish_bytes = node.create_publisher(kind, "position", _DEPTH).publish

    def publish(_stamp_ns: int, values: Sequence[float]) -> None:
        publish_bytes(template.filled(values[x], values[y]))

    return publish


def _odometry(node: RosObject, ros: RosSection, indices: Sequence[int]) -> Publish:
    kind = message_type("nav_msgs/msg/Odometry")
    message, publish_bytes = kind(), node.create_publisher(kind, "odom", _DEPTH).publish
    message.header.frame_id, message.child_frame_id = ros.odometry_frame, ros.base_frame
    position, orientation = (f"pose.pose.{what}" for what in ("position", "orientation"))
    numbers = (f"{position}.x", f"{position}.y", f"{orientation}.z", f"{orientation}.w")
    template = _stamped(message, *numbers, "twist.twist.linear.x", "twist.twist.angular.z")

    def publish(stamp_ns: int, values: Sequence[float]) -> None:
        x, y, heading, linear, angular = [values[index] for index in indices]
        half = 0.5 * heading
        publish_bytes(
            template.filled(*divmod(stamp_ns, NS_PER_S), x, y, math.sin(half), math.cos(half), linear, angular)
        )

    return publish


def _joint_states(node: RosObject, ros: RosSection, indices: Sequence[int]) -> Publish:
    kind = message_type("sensor_msgs/msg/JointState")
    message, publish_bytes = kind(), node.create_publisher(kind, "joint_states", _DEPTH).publish
    message.name = [ros.left_joint, ros.right_joint]
    message.position, message.velocity = [0.0, 0.0], [0.0, 0.0]
    template = _stamped(message, "position.0", "position.1", "velocity.0", "velocity.1")
    return _measured(publish_bytes, template, indices)


def _imu(node: RosObject, ros: RosSection, indices: Sequence[int]) -> Publish:
    kind = message_type("sensor_msgs/msg/Imu")
    message, publish_bytes = kind(), node.create_publisher(kind, "imu/data", _DEPTH).publish
    message.header.frame_id = ros.imu_frame
    message.orientation_covariance[0] = _NOT_MEASURED
    numbers = [f"{what}.{axis}" for what in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    return _measured(publish_bytes, _stamped(message, *numbers), indices)


def _measured(publish_bytes: Callable[[bytes], None], template: Template, indices: Sequence[int]) -> Publish:
    """Publishes the signals at these places with their stamp, while all of them are measured."""

    def publish(stamp_ns: int, values: Sequence[float]) -> None:
        measured = [values[index] for index in indices]
        if all(map(math.isfinite, measured)):
            publish_bytes(template.filled(*divmod(stamp_ns, NS_PER_S), *measured))

    return publish


def _stamped(message: RosObject, *numbers: str) -> Template:
    """A message of which the stamp and these numbers change."""
    return Template(message, *STAMP, *((path, "d") for path in numbers))


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
