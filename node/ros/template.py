# SPDX-License-Identifier: MIT
"""Messages as DDS carries them, of which only some numbers change from one to the next.

Publishing a message object makes rclpy convert it field by field: for an Odometry 17 us where its bytes take 3. So a
message is serialized once, by ROS itself, and from then on only its numbers are written into the bytes.
"""

import functools
import importlib
import struct
from collections.abc import Callable
from typing import Final

from segway_ecc.node.ros.untyped import RosObject

STAMP: Final = (("header.stamp.sec", "i"), ("header.stamp.nanosec", "I"))
"""The fields of a stamp: seconds, nanoseconds."""


class Template:
    """The bytes of a message with places for numbers."""

    def __init__(self, message: RosObject, *fields: tuple[str, str]) -> None:
        """Serialize a message, which keeps its values.

        Args:
            message: It holds every value that stays as it is; sequences have the length that they keep.
            fields: What changes, in the order of the message: a path such as `pose.position.x` or `position.0`, and the
                format of the number as in `struct`.

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
    """Where a number is in the bytes: where they differ between two values that have no byte in common."""
    *way, name = path.split(".")
    parent = functools.reduce(getattr, way, message)
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
    offset = next((place for place, pair in enumerate(zip(one, other, strict=True)) if pair[0] != pair[1]), 0)
    if one[offset : offset + size] != first or other[offset : offset + size] != second:
        raise ValueError(f"{path} is no number of the format '{number}' in the message")
    return offset
