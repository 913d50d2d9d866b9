# SPDX-License-Identifier: MIT
"""ROS 2 messages as bytes, from plain values and without ROS, and their definitions, so that readers need none either.

The format is the plain CDR of OMG CORBA 3.3 part 2 chapter 9.3 in the encapsulation of OMG
DDSI-RTPS 2.3 section 10 and DDS-XTypes 1.3 section 7.4.1 (XCDR1, little-endian): four bytes
`00 01 00 00`, then the fields in order, each aligned to its own size counted from after those four
bytes. A string is a uint32 length with its closing NUL, then UTF-8; a sequence is a uint32 count,
then its elements. Padding is zero. Units and axes follow REP-103: metres, radians, seconds,
x forward, y left, z up.

The definitions follow the `ros2msg` schema encoding of the MCAP format registry
(https://mcap.dev/spec/registry#ros2msg): that of the message, then each type it depends on, after a
line of 80 equal signs and a line `MSG: package/Type`. The fields are those of ROS 2 Jazzy.
"""

import operator
import struct
from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias

from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.errors import RecordingError

FLOAT64: Final = "std_msgs/msg/Float64"
POINT: Final = "geometry_msgs/msg/Point"
TWIST_STAMPED: Final = "geometry_msgs/msg/TwistStamped"
ODOMETRY: Final = "nav_msgs/msg/Odometry"
IMU: Final = "sensor_msgs/msg/Imu"
JOINT_STATE: Final = "sensor_msgs/msg/JointState"
DIAGNOSTIC_ARRAY: Final = "diagnostic_msgs/msg/DiagnosticArray"
CYCLE_EVENTS: Final = "segway_ecc/msg/CycleEvents"
STATE: Final = "segway_ecc/msg/State"

_ENCAPSULATION: Final = b"\x00\x01\x00\x00"
_COUNT: Final = struct.Struct("<I")
_STAMP: Final = struct.Struct("<iI")
_CYCLE: Final = struct.Struct("<Q")
_EVENTS_HEAD: Final = struct.Struct("<16xQI")
_FLOAT64: Final = struct.Struct("<4sd")
_POINT: Final = struct.Struct("<4s3d")

_NS_PER_S: Final = 1_000_000_000
_STAMP_LIMIT_NS: Final = 2**31 * _NS_PER_S
_COVARIANCE_LENGTH: Final = 36

# A 3 by 3 covariance of zeros is one that is not known; one that begins with -1 belongs to what is not measured.
_NO_COVARIANCE: Final = (0.0,) * 9
_NO_ORIENTATION: Final = (0.0, 0.0, 0.0, 1.0, -1.0, *_NO_COVARIANCE[1:])

# A run has a handful of frames and joint sets; the bound only keeps a mistaken caller from growing memory.
_LAYOUTS_KEPT: Final = 64

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]

UNKNOWN_COVARIANCE: Final[tuple[float, ...]] = (0.0,) * _COVARIANCE_LENGTH
"""A 6 by 6 covariance, row-major, of zeros: by ROS convention, one that is not known."""

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


class Pose(NamedTuple):
    """Where a body is, as geometry_msgs/PoseWithCovariance.

    Attributes:
        position: x, y, z in metres.
        orientation: Unit quaternion x, y, z, w.
        covariance: 36 values, 6 by 6 row-major, over x, y, z and the rotations about them.
    """

    position: Vector
    orientation: Quaternion
    covariance: Sequence[float] = UNKNOWN_COVARIANCE


class Twist(NamedTuple):
    """How a body moves, as geometry_msgs/TwistWithCovariance.

    Attributes:
        linear: Velocity along x, y, z in m/s.
        angular: Rate about x, y, z in rad/s.
        covariance: 36 values, 6 by 6 row-major, over the same six. Not part of a TwistStamped.
    """

    linear: Vector
    angular: Vector
    covariance: Sequence[float] = UNKNOWN_COVARIANCE


def split_stamp(stamp_ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds, the fields of builtin_interfaces/Time, of a time since the epoch in ns.

    Raises:
        RecordingError: It is negative, which MCAP cannot hold, or not below 2**31 s, which ROS 2 cannot.
    """
    stamp = operator.index(stamp_ns)
    if not 0 <= stamp < _STAMP_LIMIT_NS:
        raise RecordingError(
            f"The time stamp {stamp} ns lies outside 0..{_STAMP_LIMIT_NS - 1} ns, which is all a ROS 2 log can hold: "
            "pass nanoseconds since the epoch."
        )
    return divmod(stamp, _NS_PER_S)


def float64(value: float) -> bytes:
    """Returns a std_msgs/Float64."""
    return _FLOAT64.pack(_ENCAPSULATION, value)


def point(x: float, y: float, z: float) -> bytes:
    """Returns a geometry_msgs/Point; coordinates in metres."""
    return _POINT.pack(_ENCAPSULATION, x, y, z)


def twist_stamped(stamp_ns: int, frame_id: str, twist: Twist) -> bytes:
    """Returns a geometry_msgs/TwistStamped; time in ns, velocities in m/s and rad/s in `frame_id`."""
    layout, prefix = _stamped_layout((frame_id,), 6)
    return layout.pack(_ENCAPSULATION, *split_stamp(stamp_ns), prefix, *twist.linear, *twist.angular)


def odometry(stamp_ns: int, frame_id: str, child_frame_id: str, pose: Pose, twist: Twist) -> bytes:
    """Returns a nav_msgs/Odometry.

    Args:
        stamp_ns: Time in ns.
        frame_id: The fixed frame that the pose is in.
        child_frame_id: The frame on the body, which the twist is in.
        pose: Position in metres, orientation as quaternion, 36 covariances.
        twist: Velocities in m/s and rad/s, 36 covariances.
    """
    layout, prefix = _stamped_layout((frame_id, child_frame_id), 13 + 2 * _COVARIANCE_LENGTH)
    return layout.pack(
        _ENCAPSULATION,
        *split_stamp(stamp_ns),
        prefix,
        *pose.position,
        *pose.orientation,
        *pose.covariance,
        *twist.linear,
        *twist.angular,
        *twist.covariance,
    )


def joint_state(  # noqa: PLR0913, PLR0917 - the fields of the message, in their order
    stamp_ns: int,
    frame_id: str,
    names: tuple[str, ...],
    positions: Sequence[float],
    velocities: Sequence[float],
    efforts: Sequence[float] = (),
) -> bytes:
    """Returns a sensor_msgs/JointState.

    Args:
        stamp_ns: Time in ns.
        frame_id: Usually empty: a joint is in no frame.
        names: One name per joint.
        positions: rad or m, one per joint; empty if not measured.
        velocities: rad/s or m/s, one per joint; empty if not measured.
        efforts: N m or N, one per joint; empty if not measured.
    """
    counts = (len(positions), len(velocities), len(efforts))
    layout, prefix = _joint_layout(frame_id, names, counts)
    head = (_ENCAPSULATION, *split_stamp(stamp_ns), prefix)
    return layout.pack(*head, counts[0], *positions, counts[1], *velocities, counts[2], *efforts)


def imu(stamp_ns: int, frame_id: str, angular_velocity: Vector, linear_acceleration: Vector) -> bytes:
    """Returns a sensor_msgs/Imu without orientation, which the -1 in its covariance means, and without covariances.

    Args:
        stamp_ns: Time in ns.
        frame_id: The frame that both vectors are in.
        angular_velocity: About x, y, z in rad/s.
        linear_acceleration: Along x, y, z in m/s2, with what carries it against gravity.
    """
    layout, prefix = _stamped_layout((frame_id,), len(_NO_ORIENTATION) + 2 * (3 + len(_NO_COVARIANCE)))
    return layout.pack(
        _ENCAPSULATION,
        *split_stamp(stamp_ns),
        prefix,
        *_NO_ORIENTATION,
        *angular_velocity,
        *_NO_COVARIANCE,
        *linear_acceleration,
        *_NO_COVARIANCE,
    )


def diagnostic_array(stamp_ns: int, frame_id: str, statuses: Sequence[DiagnosticStatus]) -> bytes:
    """Returns a diagnostic_msgs/DiagnosticArray; time in ns."""
    body = bytearray(_STAMP.pack(*split_stamp(stamp_ns)))
    _put_text(body, frame_id)
    _put_count(body, len(statuses))
    for status in statuses:
        body.append(status.level)
        for text in (status.name, status.message, ""):  # the last is the hardware's identity
            _put_text(body, text)
        _put_count(body, len(status.values))
        for key, value in status.values.items():
            _put_text(body, key)
            _put_text(body, value)
    return _ENCAPSULATION + body


def read_diagnostic_array(data: bytes) -> tuple[int, list[tuple[str, dict[str, str]]]]:
    """The stamp, ns, and of each status its name and values, from the bytes that `diagnostic_array` returned.

    Raises:
        RecordingError: They are not such bytes.
    """
    try:
        seconds, rest_ns = _STAMP.unpack_from(data, len(_ENCAPSULATION))
        position, found = _skip_text(data, _STAMP.size), []
        count, position = _take_count(data, position)
        for _ in range(count):
            name, position = _take_text(data, position + 1)  # behind the level
            position = _skip_text(data, _skip_text(data, position))
            values: dict[str, str] = {}
            many, position = _take_count(data, position)
            for _ in range(many):
                key, position = _take_text(data, position)
                values[key], position = _take_text(data, position)
            found.append((name, values))
    except (struct.error, UnicodeDecodeError) as error:
        raise RecordingError(f"a message of diagnostics is damaged: {error}") from error
    return seconds * _NS_PER_S + rest_ns, found


def cycle_events(stamp_ns: int, cycle: int, texts: Sequence[str]) -> bytes:
    """Returns a segway_ecc/CycleEvents: time in ns, the number of the cycle, and what happened in it."""
    body = bytearray(_STAMP.pack(*split_stamp(stamp_ns)))
    _put_text(body, "")
    _align(body, 8)
    body += _CYCLE.pack(cycle)
    _put_count(body, len(texts))
    for text in texts:
        _put_text(body, text)
    return _ENCAPSULATION + body


def read_cycle_events(data: bytes) -> tuple[int, list[str]]:
    """The number of the cycle, and what happened in it, from the bytes that `cycle_events` returned.

    Raises:
        RecordingError: They are not such bytes.
    """
    offset = len(_ENCAPSULATION)
    try:
        cycle, count = _EVENTS_HEAD.unpack_from(data, offset)
        position, texts = _EVENTS_HEAD.size, []
        for _ in range(count):
            position += -position % 4
            (length,) = _COUNT.unpack_from(data, offset + position)
            position += _COUNT.size
            texts.append(data[offset + position : offset + position + length - 1].decode())
            position += length
    except (struct.error, UnicodeDecodeError) as error:
        raise RecordingError(f"a message on /cycle_events is damaged: {error}") from error
    return cycle, texts


def state(stamp_ns: int, cycle: int, snapshot: bytes) -> bytes:
    """Returns a segway_ecc/State: time in ns, the number of the cycle that it belongs before, and its MessagePack."""
    head = cycle_events(stamp_ns, cycle, ())
    return head[: -_COUNT.size] + _COUNT.pack(len(snapshot)) + snapshot


def read_state(data: bytes) -> bytes:
    """The MessagePack in the bytes that `state` returned."""
    return data[len(_ENCAPSULATION) + _EVENTS_HEAD.size :]


@lru_cache(maxsize=_LAYOUTS_KEPT)
def _stamped_layout(texts: tuple[str, ...], doubles: int) -> tuple[struct.Struct, bytes]:
    """Returns the layout of a stamp, strings and doubles, and the strings as encoded."""
    body = bytearray(_STAMP.size)
    for text in texts:
        _put_text(body, text)
    _align(body, 8)
    prefix = bytes(body[_STAMP.size :])
    return struct.Struct(f"<4siI{len(prefix)}s{doubles}d"), prefix


@lru_cache(maxsize=_LAYOUTS_KEPT)
def _joint_layout(frame_id: str, names: tuple[str, ...], counts: tuple[int, ...]) -> tuple[struct.Struct, bytes]:
    body = bytearray(_STAMP.size)
    _put_text(body, frame_id)
    _put_count(body, len(names))
    for name in names:
        _put_text(body, name)
    _align(body, 4)
    prefix = bytes(body[_STAMP.size :])
    layout = f"<4siI{len(prefix)}s"
    offset = len(body)
    for count in counts:
        # Alignment belongs to the elements, so an empty sequence has none after its count.
        padding = -(offset + 4) % 8 if count else 0
        layout += f"I{padding}x{count}d"
        offset += 4 + padding + 8 * count
    return struct.Struct(layout), prefix


def _align(body: bytearray, size: int) -> None:
    body.extend(bytes(-len(body) % size))


def _put_count(body: bytearray, count: int) -> None:
    _align(body, 4)
    body += _COUNT.pack(count)


def _put_text(body: bytearray, text: str) -> None:
    # A CDR string can hold neither a NUL nor half a surrogate pair. Both come from broken input that a log should
    # show, not trip over, so they are written as escapes.
    encoded = text.encode("utf-8", "backslashreplace").replace(b"\0", rb"\x00")
    _put_count(body, len(encoded) + 1)
    body += encoded
    body.append(0)


def _take_count(data: bytes, position: int) -> tuple[int, int]:
    """A count at a position behind the encapsulation, and where it ends."""
    position += -position % 4
    return _COUNT.unpack_from(data, len(_ENCAPSULATION) + position)[0], position + _COUNT.size


def _skip_text(data: bytes, position: int) -> int:
    length, position = _take_count(data, position)
    return position + length


def _take_text(data: bytes, position: int) -> tuple[str, int]:
    length, position = _take_count(data, position)
    begin = len(_ENCAPSULATION) + position
    return data[begin : begin + length - 1].decode(), position + length


def definition(lines: Sequence[str], parts: Mapping[str, Sequence[str]] = MappingProxyType({})) -> str:
    """The text of a message of these fields and constants; `parts` are types that ROS 2 does not know, by name."""
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
STATE_SCHEMA: Final = definition(["std_msgs/Header header", "uint64 cycle", "uint8[] snapshot"])
"""That of the message on `/state`."""
