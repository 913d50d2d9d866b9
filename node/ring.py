"""Messages from one process to another, through memory that both have mapped.

Neither side makes a system call, takes a lock or waits, so that a loop may write or read in each cycle. The memory
outlives the process that writes: what was put is read also where that process was killed.

A slot is one byte that says what it holds, `FREE` for nothing; the length and the CRC of its message; and that message.
The writer touches no slot that is not free and writes that byte last; the reader touches no other and frees it last. A
processor other than x86 may show the byte before the message: then the CRC is wrong, and the reader looks again later.
The CRC begins with the message's number, so that what a slot held before is not taken for what it is to hold.
"""

import mmap
import os
import struct
import zlib
from collections.abc import Iterator
from typing import Final

FREE: Final = 0
"""The kind of no message."""
SLOT_BYTES: Final = 4096
"""Of a slot, where nothing else is said."""
_HEAD: Final = struct.Struct("<HI")
"""Length and CRC-32 of a message."""
_MESSAGE: Final = 1 + _HEAD.size
_FIRST: Final = 1
"""Number of the first message: nothing at all has the CRC of an empty message of number 0."""
_NUMBERS: Final = 0xFFFFFFFF
ROOM: Final = SLOT_BYTES - _MESSAGE
"""For a message, where nothing else is said, bytes."""
LARGEST: Final = 0xFFFF
"""A message in any ring, bytes."""


def slot_for(size: int) -> int:
    """Of what size a slot is that takes messages of `size` bytes, and such as `ROOM` has room for."""
    return max(SLOT_BYTES, size + _MESSAGE)


def open_ring(slots: int = 0, slot_bytes: int = SLOT_BYTES) -> int:
    """Make the memory of a ring; see `size_ring`.

    Returns:
        Its file descriptor.
    """
    descriptor = os.memfd_create("segway-ecc-ring")
    size_ring(descriptor, slots, slot_bytes)
    return descriptor


def size_ring(descriptor: int, slots: int, slot_bytes: int = SLOT_BYTES) -> None:
    """Give a ring its size, before anybody maps it.

    Args:
        descriptor: That of its memory.
        slots: How many messages it holds.
        slot_bytes: Room for each, as `slot_for` tells.
    """
    os.ftruncate(descriptor, slots * slot_bytes)


class RingWriter:
    """The side that puts messages; one thread at a time.

    Attributes:
        room: For a message, bytes.
    """

    __slots__ = ("_begin", "_number", "_ring", "_size", "_slot_bytes", "room")

    def __init__(self, descriptor: int, slot_bytes: int = SLOT_BYTES) -> None:
        """Map the memory and fill it, so that no page is missing later."""
        self.room = min(slot_bytes - _MESSAGE, LARGEST)
        self._size = os.fstat(descriptor).st_size
        self._slot_bytes = slot_bytes
        self._ring = mmap.mmap(descriptor, self._size)
        self._ring[:] = bytes(self._size)
        self._begin = 0
        self._number = _FIRST

    def put(self, kind: int, message: bytes | bytearray) -> bool:
        """Hand over a message; False where there is no room for it.

        Args:
            kind: What the message is, any byte but `FREE`.
            message: It; `room` is how long it may be.
        """
        begin, ring = self._begin, self._ring
        length = len(message)
        first = begin + _MESSAGE
        if ring[begin] != FREE or length > self.room:
            return False
        _HEAD.pack_into(ring, begin + 1, length, zlib.crc32(message, self._number))
        ring[first : first + length] = message
        ring[begin] = kind
        self._begin = (begin + self._slot_bytes) % self._size
        self._number = (self._number + 1) & _NUMBERS
        return True

    def held(self) -> int:
        """How many messages are in it that nobody has taken."""
        return sum(self._ring[begin] != FREE for begin in range(0, self._size, self._slot_bytes))


class RingReader:
    """The side that takes them; one thread at a time.

    Attributes:
        damaged: Messages that were not as they had been put, and were passed over.
    """

    __slots__ = ("_begin", "_is_doubtful", "_number", "_ring", "_size", "_slot_bytes", "damaged")

    def __init__(self, descriptor: int, slot_bytes: int = SLOT_BYTES) -> None:
        """Map the memory."""
        self._size = os.fstat(descriptor).st_size
        self._slot_bytes = slot_bytes
        self._ring = mmap.mmap(descriptor, self._size)
        self._begin = 0
        self._number = _FIRST
        self._is_doubtful = False
        self.damaged = 0

    def take(self) -> tuple[int, bytes] | None:
        """The kind of the oldest message, and it; None where there is none that has arrived whole."""
        begin, ring = self._begin, self._ring
        kind = ring[begin]
        if kind == FREE:
            return None
        length, crc = _HEAD.unpack_from(ring, begin + 1)
        first = begin + _MESSAGE
        message = ring[first : first + length]
        if zlib.crc32(message, self._number) == crc:
            self._free()
            return kind, message
        # What comes late comes within microseconds: at the next look it is there, or never.
        if self._is_doubtful:
            self.damaged += 1
            self._free()
        else:
            self._is_doubtful = True
        return None

    def take_all(self) -> Iterator[tuple[int, bytes]]:
        """The messages that are there, oldest first."""
        while (taken := self.take()) is not None:
            yield taken

    def _free(self) -> None:
        self._ring[self._begin] = FREE
        self._begin = (self._begin + self._slot_bytes) % self._size
        self._number = (self._number + 1) & _NUMBERS
        self._is_doubtful = False
