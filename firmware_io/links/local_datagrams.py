# SPDX-License-Identifier: MIT
"""What passes on the virtual bus of one machine: a datagram for each frame."""

import os
import struct
import time
from typing import Final

from segway_ecc.firmware_io.links.can_port import MAX_DATA

BUFFER_BYTES: Final = 256
"""More than a datagram has, so that a longer one is known for what it is."""
_MAGIC: Final = b"ECC1"
_DATAGRAM: Final = struct.Struct("<4sQQIBx8s")
"""Magic, sender, wall-clock ns, arbitration id with the flags of linux/can.h, data length, data."""


Datagram = tuple[int, int, int, int, bytes]
"""A frame on the virtual bus: who of its participants sent it; when, on the wall clock, ns; its identifier with the
flags of linux/can.h; the length that it states, 0 to 8; and as many bytes."""


def new_sender() -> int:
    """A number that no other participant has."""
    return int.from_bytes(os.urandom(8), "little")


def encode(sender: int, word: int, length: int, data: bytes) -> bytes:
    """A datagram, stamped with the wall clock's time of now."""
    return _DATAGRAM.pack(_MAGIC, sender, time.clock_gettime_ns(time.CLOCK_REALTIME), word, length, data)


def decode(datagram: bytes) -> Datagram | None:
    """The frame in a datagram; None where there is none."""
    if len(datagram) != _DATAGRAM.size:
        return None
    magic, sender, stamp_ns, word, length, data = _DATAGRAM.unpack(datagram)
    if magic != _MAGIC or length > MAX_DATA:
        return None
    return sender, stamp_ns, word, length, data[:length]
