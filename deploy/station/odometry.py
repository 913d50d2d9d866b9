# SPDX-License-Identifier: MIT
"""A nav_msgs/Odometry read from its bytes: rclpy takes 0.2 ms to make one into objects, most of it for covariances."""

import math
import struct
from typing import Final

from segway_ecc.node.sequence.player import Odometry

_ENCAPSULATION: Final = 4
_COVARIANCE: Final = 36 * 8
_NS_PER_S: Final = 1_000_000_000


def read_odometry(data: bytes) -> Odometry | None:
    """Decode XCDR1 as ROS 2 sends it (OMG DDSI-RTPS 2.3, 10.2); None where the bytes are not that or not finite.

    Args:
        data: The serialized message with its four bytes of encapsulation.
    """
    try:
        order = "<" if data[1] == 1 else ">"
        body = memoryview(data)[_ENCAPSULATION:]
        sec, nanosec = struct.unpack_from(f"{order}iI", body)
        at = _after_text(body, _after_text(body, 8, order), order)
        at = -(-at // 8) * 8
        x, y, _, _, _, z, w = struct.unpack_from(f"{order}7d", body, at)
        linear, _, _, _, _, angular = struct.unpack_from(f"{order}6d", body, at + 7 * 8 + _COVARIANCE)
    except (struct.error, IndexError):
        return None
    heading = math.remainder(2.0 * math.atan2(z, w), math.tau)
    odometry = Odometry(sec * _NS_PER_S + nanosec, x, y, heading, linear, angular)
    return odometry if all(map(math.isfinite, odometry)) else None


def _after_text(body: memoryview, at: int, order: str) -> int:
    """Where a string that begins at the next multiple of four ends."""
    at = -(-at // 4) * 4
    (length,) = struct.unpack_from(f"{order}I", body, at)
    return int(at + 4 + length)
