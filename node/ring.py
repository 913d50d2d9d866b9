# SPDX-License-Identifier: MIT
"""Messages from one process to another, through memory that both have mapped.

Neither side makes a system call, takes a lock or waits, so that a loop may write or read in each cycle. The memory
outlives the process that writes: what was put is read also where that process was killed.

The memory begins with a byte for each slot, which is what it holds: `FREE`, the kind of the message that begins
there, or `CONTINUED`. The slots follow. A message takes as many of them in a row as it needs, after its length and its
CRC. The writer touches no slot that is not free and writes the kind last; the reader touches no other and frees slots
in their order. A processor other than x86 may show the kind before the message: then the CRC is wrong, and the reader
looks again later. The CRC begins with the message's number: what a slot held before is not taken for what it holds now.
"""

import mmap
import os
import struct
import zlib
from collections.abc import Iterator
from typing import Final

FREE: Final = 0
"""The kind of no message."""
CONTINUED: Final = 255
"""Nor is this one: it marks what a message takes after its first slot."""
SLOT_BYTES: Final = 256
_HEAD: Final = struct.Struct("<HI")
"""Length and CRC-32 of a message."""
_FIRST: Final = 1
"""Number of the first message: nothing at all has the CRC of an empty message of number 0."""
_NUMBERS: Final = 0xFFFFFFFF
LARGEST: Final = 0xFFFF
"""A message in any ring, bytes."""


def slots_for(size: int) -> int:
    """How many slots a message of `size` bytes takes."""
    return -(-(_HEAD.size + size) // SLOT_BYTES)


def open_ring(slots: int = 0) -> int:
    """Make the memory of a ring, and return its file descriptor; see `size_ring`."""
    descriptor = os.memfd_create("segway-ecc-ring")
    size_ring(descriptor, slots)
    return descriptor


def size_ring(descriptor: int, slots: int) -> None:
    """Give a ring its size, before anybody maps it; `slots_for` is what a message takes."""
    os.ftruncate(descriptor, slots * (1 + SLOT_BYTES))


class RingWriter:
    """The side that puts messages, one thread at a time; an empty ring has room for a message of `room` bytes."""

    __slots__ = ("_begin", "_number", "_ring", "_size", "_slots", "room")

    def __init__(self, descriptor: int) -> None:
        """Map the memory and fill it, so that no page is missing later."""
        self._size = os.fstat(descriptor).st_size
        self._slots = self._size // (1 + SLOT_BYTES)
        self.room = min(self._slots * SLOT_BYTES - _HEAD.size, LARGEST)
        self._ring = mmap.mmap(descriptor, self._size)
        self._ring[:] = bytes(self._size)
        self._begin = 0
        self._number = _FIRST

    def put(self, kind: int, message: bytes | bytearray) -> bool:
        """Hand over a message of up to `room` bytes; False where there is no room for it.

        Its kind is any byte but `FREE` and `CONTINUED`.
        """
        begin, ring, slots = self._begin, self._ring, self._slots
        length = len(message)
        end = begin + (_HEAD.size + length - 1) // SLOT_BYTES  # its last slot
        # Slots are freed in their order: where its last one is free, all before it are.
        if length > self.room or ring[end % slots] != FREE:
            return False
        head = slots + begin * SLOT_BYTES
        first = head + _HEAD.size
        _HEAD.pack_into(ring, head, length, zlib.crc32(message, self._number))
        over = first + length - self._size
        if over <= 0:
            ring[first : first + length] = message
        else:
            ring[first:] = message[: length - over]
            ring[slots : slots + over] = message[length - over :]
        for slot in range(begin + 1, end + 1):
            ring[slot % slots] = CONTINUED
        ring[begin] = kind
        self._begin = (end + 1) % slots
        self._number = (self._number + 1) & _NUMBERS
        return True

    def held(self) -> int:
        """How many messages are in it that nobody has taken."""
        return sum(mark not in (FREE, CONTINUED) for mark in self._ring[: self._slots])


class RingReader:
    """The side that takes them, one thread at a time; `damaged` were not as they had been put, and were passed over."""

    __slots__ = ("_begin", "_is_doubtful", "_number", "_ring", "_size", "_slots", "damaged")

    def __init__(self, descriptor: int) -> None:
        """Map the memory."""
        self._size = os.fstat(descriptor).st_size
        self._slots = self._size // (1 + SLOT_BYTES)
        self._ring = mmap.mmap(descriptor, self._size)
        self._begin = 0
        self._number = _FIRST
        self._is_doubtful = False
        self.damaged = 0

    def take_message(self) -> tuple[int, bytes] | None:
        """The kind of the oldest message, and it; None where there is none that has arrived whole."""
        ring, slots = self._ring, self._slots
        kind = ring[self._begin]
        if kind == FREE:
            return None
        head = slots + self._begin * SLOT_BYTES
        length, crc = _HEAD.unpack_from(ring, head)
        first = head + _HEAD.size
        message = ring[first : first + length]
        if len(message) < length:
            message += ring[slots : slots + length - len(message)]
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

    def take_messages(self) -> Iterator[tuple[int, bytes]]:
        """The messages that are there, oldest first."""
        while (taken := self.take_message()) is not None:
            yield taken

    def _free(self) -> None:
        ring, slot = self._ring, self._begin
        ring[slot] = FREE
        while ring[slot := (slot + 1) % self._slots] == CONTINUED:
            ring[slot] = FREE
        self._begin = slot
        self._number = (self._number + 1) & _NUMBERS
        self._is_doubtful = False
