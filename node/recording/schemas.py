# SPDX-License-Identifier: MIT
"""The ROS 2 message definitions that a log carries, so that readers need no ROS.

The texts follow the `ros2msg` schema encoding of the MCAP format registry
(https://mcap.dev/spec/registry#ros2msg): the definition of the message, then each type it depends
on, after a line of 80 equal signs and a line `MSG: package/Type`. The fields are those of ROS 2
Jazzy; lengths are in metres, angles in radians, as REP-103 asks.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

FLOAT64: Final = "std_msgs/msg/Float64"
POINT: Final = "geometry_msgs/msg/Point"
TWIST_STAMPED: Final = "geometry_msgs/msg/TwistStamped"
ODOMETRY: Final = "nav_msgs/msg/Odometry"
IMU: Final = "sensor_msgs/msg/Imu"
JOINT_STATE: Final = "sensor_msgs/msg/JointState"
DIAGNOSTIC_ARRAY: Final = "diagnostic_msgs/msg/DiagnosticArray"
CYCLE_EVENTS: Final = "segway_ecc/msg/CycleEvents"

_SEPARATOR: Final = "=" * 80

# One line per field. Defaults and constants are part of a definition, so they stay.
_FIELDS: Final[dict[str, tuple[str, ...]]] = {
    "builtin_interfaces/Time": ("int32 sec", "uint32 nanosec"),
    "std_msgs/Header": ("builtin_interfaces/Time stamp", "string frame_id"),
    "std_msgs/Float64": ("float64 data",),
    "geometry_msgs/Point": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/Vector3": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/Quaternion": ("float64 x 0", "float64 y 0", "float64 z 0", "float64 w 1"),
    "geometry_msgs/Pose": ("geometry_msgs/Point position", "geometry_msgs/Quaternion orientation"),
    "geometry_msgs/PoseWithCovariance": ("geometry_msgs/Pose pose", "float64[36] covariance"),
    "geometry_msgs/Twist": ("geometry_msgs/Vector3 linear", "geometry_msgs/Vector3 angular"),
    "geometry_msgs/TwistWithCovariance": ("geometry_msgs/Twist twist", "float64[36] covariance"),
    "geometry_msgs/TwistStamped": ("std_msgs/Header header", "geometry_msgs/Twist twist"),
    "nav_msgs/Odometry": (
        "std_msgs/Header header",
        "string child_frame_id",
        "geometry_msgs/PoseWithCovariance pose",
        "geometry_msgs/TwistWithCovariance twist",
    ),
    "sensor_msgs/Imu": (
        "std_msgs/Header header",
        "geometry_msgs/Quaternion orientation",
        "float64[9] orientation_covariance",
        "geometry_msgs/Vector3 angular_velocity",
        "float64[9] angular_velocity_covariance",
        "geometry_msgs/Vector3 linear_acceleration",
        "float64[9] linear_acceleration_covariance",
    ),
    "sensor_msgs/JointState": (
        "std_msgs/Header header",
        "string[] name",
        "float64[] position",
        "float64[] velocity",
        "float64[] effort",
    ),
    "diagnostic_msgs/KeyValue": ("string key", "string value"),
    "diagnostic_msgs/DiagnosticStatus": (
        "byte OK=0",
        "byte WARN=1",
        "byte ERROR=2",
        "byte STALE=3",
        "byte level",
        "string name",
        "string message",
        "string hardware_id",
        "diagnostic_msgs/KeyValue[] values",
    ),
    "diagnostic_msgs/DiagnosticArray": ("std_msgs/Header header", "diagnostic_msgs/DiagnosticStatus[] status"),
}


def definition(lines: Sequence[str], parts: Mapping[str, Sequence[str]] = MappingProxyType({})) -> str:
    """The text of a message.

    Args:
        lines: Its fields and constants.
        parts: Types that it is built from and that ROS 2 does not know, by name, each with its own lines.
    """
    known = {**_FIELDS, **parts}
    text = "\n".join(lines) + "\n"
    for part in _dependencies(lines, known):
        text += "\n".join((_SEPARATOR, f"MSG: {part}", *known[part])) + "\n"
    return text


def _dependencies(lines: Sequence[str], known: Mapping[str, Sequence[str]]) -> list[str]:
    """The types that `lines` are built from, each once, in order of first use."""
    found: dict[str, None] = {}
    for line in lines:
        part = line.split()[0].partition("[")[0]
        if part in known:
            found.update(dict.fromkeys([part, *_dependencies(known[part], known)]))
    return list(found)


SCHEMAS: Final[dict[str, str]] = {
    name: definition(_FIELDS[name.replace("/msg/", "/")])
    for name in (FLOAT64, POINT, TWIST_STAMPED, ODOMETRY, IMU, JOINT_STATE, DIAGNOSTIC_ARRAY)
}
"""The `ros2msg` text of each message that a log can hold, by its full name, as `std_msgs/msg/Float64`."""

CYCLE_EVENTS_SCHEMA: Final = definition(["std_msgs/Header header", "uint64 cycle", "string[] events"])
"""The `ros2msg` text of the message on `/cycle_events`, which is of our own making."""
