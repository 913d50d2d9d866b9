"""What lies between the loop and the process that writes the log: slots in memory that both have mapped.

A message is handed over with no system call and no lock. The memory outlives the loop's process: what was put is read
also where that process was killed.

A slot is one byte that says what it holds, and then that message. `FREE` fills what is free, that byte too. The loop
writes the message first and the byte last, and touches no slot that is not free. A processor other than x86 may show
the byte to the reader before the message. So the reader takes a slot one look after it saw that it was full, and frees
one a look after it filled it up again; looks are some milliseconds apart, and a store is late by microseconds at most.
And MessagePack never uses the byte `FREE`: a message of which a part is missing is none.
"""

import mmap
import os
from collections.abc import Iterator
from typing import Final

FREE: Final = 0xC1
"""The one byte that begins nothing in MessagePack, and that no UTF-8 has."""
SLOT_BYTES: Final = 4096
ROOM: Final = SLOT_BYTES - 1
"""For a message, bytes."""
SLOTS: Final = 2048
"""Room for 20 s at 100 Hz while a disk is busy."""
RING_BYTES: Final = SLOTS * SLOT_BYTES
_FILL: Final = bytes((FREE,))


def open_ring() -> int:
    """Make the memory of a ring.

    Returns:
        Its file descriptor.
    """
    descriptor = os.memfd_create("segway-ecc-recorder")
    os.ftruncate(descriptor, RING_BYTES)
    return descriptor


class RingWriter:
    """The loop's side."""

    __slots__ = ("_begin", "_ring")

    def __init__(self, descriptor: int) -> None:
        """Map the memory and fill it, so that no page is missing later."""
        self._ring = mmap.mmap(descriptor, RING_BYTES)
        self._ring[:] = _FILL * RING_BYTES
        self._begin = 0

    def put(self, kind: int, message: bytes | bytearray) -> bool:
        """Hand over a message that ends with another byte than `FREE`; False where there is no room for it.

        Args:
            kind: What the message is, any byte but `FREE`.
            message: It, `ROOM` bytes at most.
        """
        begin, ring = self._begin, self._ring
        end = begin + 1 + len(message)
        if ring[begin] != FREE or end > begin + SLOT_BYTES:
            return False
        ring[begin + 1 : end] = message
        ring[begin] = kind
        self._begin = (begin + SLOT_BYTES) % RING_BYTES
        return True

    def held(self) -> int:
        """How many messages are in it that nobody has taken."""
        return sum(self._ring[begin] != FREE for begin in range(0, RING_BYTES, SLOT_BYTES))


class RingReader:
    """The side of the process that writes the log."""

    def __init__(self, descriptor: int) -> None:
        """Map the memory."""
        self._ring = mmap.mmap(descriptor, RING_BYTES)
        self._freed = self._taken = self._seen = 0

    def take(self, *, is_last: bool = False) -> Iterator[tuple[bytes, bytes]]:
        """The messages that were there at the last look, each with its kind.

        Args:
            is_last: Nobody puts messages any more: all that are there.
        """
        self._free()
        settled, self._seen = self._seen, self._look()
        while self._taken < (self._seen if is_last else settled):
            yield self._taken_from(_begin(self._taken))
            self._taken += 1
        if is_last:
            self._free()

    def _look(self) -> int:
        """How many messages there have ever been."""
        seen = self._seen
        while seen < self._freed + SLOTS and self._ring[_begin(seen)] != FREE:
            seen += 1
        return seen

    def _taken_from(self, begin: int) -> tuple[bytes, bytes]:
        kind, slot = self._ring[begin : begin + 1], self._ring[begin + 1 : begin + SLOT_BYTES]
        message = slot.rstrip(_FILL)
        self._ring[begin + 1 : begin + 1 + len(message)] = _FILL * len(message)
        return kind, message

    def _free(self) -> None:
        for number in range(self._freed, self._taken):
            self._ring[_begin(number)] = FREE
        self._freed = self._taken


def _begin(number: int) -> int:
    return number % SLOTS * SLOT_BYTES
