# SPDX-License-Identifier: MIT
"""Standard messages from plain values: as objects of rclpy, and as the bytes that DDS carries.

Publishing a message object makes rclpy convert it field by field: for an Odometry 17 us where its bytes take 3. So a
message of each cycle is serialized once, by ROS itself, and from then on only its numbers are written into the bytes.
"""

import functools
import importlib
import struct
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeAlias

from segway_ecc.node.cycle.status import DiagnosticStatus

RosObject: TypeAlias = Any
"""A node, publisher, message or other object of ROS 2's Python packages, which carry no type information."""
TF2: Final = "tf2_msgs"
"""Part of every installation of ROS, and no wheel on PyPI: without it no transform is published."""
TWIST_TYPE: Final = "geometry_msgs/msg/Twist"
TWIST_STAMPED_TYPE: Final = "geometry_msgs/msg/TwistStamped"
NS_PER_S: Final = 1_000_000_000
STAMP: Final = (("header.stamp.sec", "i"), ("header.stamp.nanosec", "I"))
"""The fields of a stamp: seconds, nanoseconds."""


def message_type(name: str) -> RosObject:
    """The class of a message or service type such as `geometry_msgs/msg/Twist`."""
    package, kind, type_name = name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), type_name)


def decode_message(data: bytes, kind: RosObject) -> RosObject:
    """A message of a type from the bytes that DDS carries.

    Raises:
        RuntimeError: They are no such message.
    """
    return importlib.import_module("rclpy.serialization").deserialize_message(data, kind)


def newest_only() -> RosObject:
    """Quality of service for what only the newest of matters: a lost message is not sent again."""
    qos = importlib.import_module("rclpy.qos")
    return qos.QoSProfile(depth=1, reliability=qos.ReliabilityPolicy.BEST_EFFORT)


def kept_for_latecomers() -> RosObject:
    """Quality of service for what is published once: whoever subscribes later receives it too."""
    qos = importlib.import_module("rclpy.qos")
    return qos.QoSProfile(depth=1, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)


def set_stamp(header: RosObject, stamp_ns: int) -> None:
    """Write a stamp, ns since the Unix epoch, into a std_msgs/Header."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)


def stamp_ns(header: RosObject) -> int:
    """The stamp of a std_msgs/Header, ns since the Unix epoch."""
    return int(header.stamp.sec) * NS_PER_S + int(header.stamp.nanosec)


def diagnostic_array(
    statuses: Sequence[DiagnosticStatus], stamp_ns: int, hardware_id: str, prefix: str = ""
) -> RosObject:
    """A diagnostic_msgs/DiagnosticArray of a robot; `prefix` begins the name of each status."""
    array = message_type("diagnostic_msgs/msg/DiagnosticArray")()
    set_stamp(array.header, stamp_ns)
    key_value, kind = message_type("diagnostic_msgs/msg/KeyValue"), message_type("diagnostic_msgs/msg/DiagnosticStatus")
    for status in statuses:
        values = [key_value(key=key, value=value) for key, value in status.values.items()]
        level = bytes((status.level,))
        name, message = f"{prefix}{status.name}", status.message
        array.status.append(kind(level=level, name=name, message=message, hardware_id=hardware_id, values=values))
    return array


def duration(seconds: float) -> RosObject:
    """An rclpy Duration."""
    return importlib.import_module("rclpy.duration").Duration(seconds=seconds)


class Template:
    """The bytes of a message, of which only some numbers change from one to the next."""

    def __init__(self, message: RosObject, *fields: tuple[str, str]) -> None:
        """Serialize a message, which keeps its values.

        Args:
            message: It holds every value that stays as it is; sequences have the length that they keep.
            fields: What changes, in the order of the message: a path such as `pose.position.x`, `position.0` or
                `transforms.0.header.stamp.sec`, and the format of the number as in `struct`.

        Raises:
            ValueError: A field is not where it was expected.
        """
        serialize: Callable[[RosObject], bytes] = importlib.import_module("rclpy.serialization").serialize_message
        whole = serialize(message)
        layout, place = "<", 0
        self._parts: list[bytes | float] = []
        self._places: list[int] = []
        for path, number in fields:
            offset = _offset(message, path, number, serialize)
            if offset < place:
                raise ValueError(f"{path} comes before another field in the message")
            layout += f"{offset - place}s{number}"
            self._parts += [whole[place:offset], 0]
            self._places.append(len(self._parts) - 1)
            place = offset + struct.calcsize(f"<{number}")
        self._parts.append(whole[place:])
        self._struct = struct.Struct(f"{layout}{len(whole) - place}s")

    def filled(self, *values: float) -> bytes:
        """The message with these numbers, in the order of the fields."""
        parts = self._parts
        for place, value in zip(self._places, values, strict=True):
            parts[place] = value
        return self._struct.pack(*parts)


def _offset(message: RosObject, path: str, number: str, serialize: Callable[[RosObject], bytes]) -> int:
    """Where a number is in the bytes: the one place that holds each of two values.

    Not the first place that differs: what lies between the fields, to align them, is of no value and never written.

    Raises:
        ValueError: There is no such place, or more than one.
    """
    *way, name = path.split(".")
    parent = functools.reduce(lambda at, part: at[int(part)] if part.isdecimal() else getattr(at, part), way, message)
    is_item = name.isdecimal()

    def write(value: RosObject) -> None:
        if is_item:
            parent[int(name)] = value
        else:
            setattr(parent, name, value)

    size = struct.calcsize(f"<{number}")
    first, second = (bytes(range(start, start + size)) for start in (1, 17))
    before = parent[int(name)] if is_item else getattr(parent, name)
    serialized = []
    for raw in (first, second):
        write(struct.unpack(f"<{number}", raw)[0])
        serialized.append(serialize(message))
    write(before)
    one, other = serialized
    places = range(len(one) - size + 1)
    found = [at for at in places if one[at : at + size] == first and other[at : at + size] == second]
    if len(found) != 1:
        raise ValueError(f"{path} is no number of the format '{number}' in the message")
    return found[0]
