# SPDX-License-Identifier: MIT
"""End-to-end protection of our own frames: a message counter and a CRC over data and identifier.

CRC-8H2F and the data identifier follow AUTOSAR E2E profile 2 ("Specification of CRC Routines" and "E2E Protocol
Specification"): polynomial 0x2F, initial value 0xFF, final XOR 0xFF. The identifier is part of the sum, so that a frame
that arrives under another identifier is refused.
"""

import binascii
import enum
from collections import Counter
from typing import Final

COUNTER_VALUES: Final = 16
MAX_LOST: Final = 5
"""Frames in a row that may be missing before the sequence counts as broken."""


def _table_entry(value: int) -> int:
    for _ in range(8):
        value = (value << 1) ^ (0x2F if value & 0x80 else 0)
    return value & 0xFF


_TABLE: Final = bytes(map(_table_entry, range(256)))


def frame_crc(arbitration_id: int, data: bytes) -> int:
    """CRC-8H2F of a frame: its data without the CRC byte, then its identifier, low byte first."""
    crc = 0xFF
    for byte in data:
        crc = _TABLE[crc ^ byte]
    crc = _TABLE[crc ^ arbitration_id & 0xFF]
    return _TABLE[crc ^ arbitration_id >> 8] ^ 0xFF


def crc16_xmodem(data: bytes) -> int:
    """CRC-16/XMODEM of `data`: polynomial 0x1021, initial value 0, nothing reflected or inverted."""
    return binascii.crc_hqx(data, 0)


@enum.unique
class Refusal(enum.StrEnum):
    """Why a frame was not taken."""

    LENGTH = "length"
    CRC = "crc"
    COUNTER = "counter"
    RANGE = "range"
    UNKNOWN = "unknown"


class FrameRefusedError(ValueError):
    """A frame that must not be used, or a value that no frame can carry: what every codec raises, and nothing else."""

    def __init__(self, refusal: Refusal, what: str) -> None:
        """State the cause and what it was."""
        self.refusal = refusal
        super().__init__(f"{what} refused: {refusal}")


def begins(received: bytearray, begin: bytes, refused: Counter[str]) -> bool:
    """Whether a packet begins in what was received: what stands before it is removed, and counted as garbage.

    Where none does, the last byte stays: it may be the first of two that begin one.
    """
    place = received.find(begin)
    skipped = place if place >= 0 else max(len(received) - 1, 0)
    refused["garbage"] += skipped
    del received[:skipped]
    return place >= 0


class CounterCheck:
    """Follows the message counter of one identifier.

    The next few counts are taken, and what is missing between is counted as lost. A repeated count, or one too far on,
    is refused; it becomes the new reference, so that a sender that restarted is followed from its second frame.
    """

    __slots__ = ("_last", "lost")

    def __init__(self) -> None:
        self._last: int | None = None
        self.lost = 0

    def accepts(self, counter: int) -> bool:
        """Whether a frame with this counter (0 to 15) may be used."""
        last, self._last = self._last, counter
        if last is None:
            return True
        ahead = (counter - last) % COUNTER_VALUES
        if not 1 <= ahead <= MAX_LOST + 1:
            return False
        self.lost += ahead - 1
        return True
