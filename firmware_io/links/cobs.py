# SPDX-License-Identifier: MIT
"""Consistent Overhead Byte Stuffing: packets without a zero byte, so that zero can stand between them.

Source: Cheshire and Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Transactions on Networking 7 (1999). Each
block begins with a code, one more than the number of its bytes that follow; a code below 255 stands for a zero after
them, except in the last block.
"""

from collections import Counter
from typing import Final

DELIMITER: Final = b"\x00"

_FULL: Final = 0xFF
"""The code of a block of 254 bytes that no zero follows."""
_LONGEST_BLOCK: Final = _FULL - 1


class CobsError(ValueError):
    """Bytes that no packet is stuffed into."""


def encode(data: bytes) -> bytes:
    """Stuff a packet; the result has no zero byte and is at least one byte long."""
    runs = data.split(DELIMITER)
    coded = bytearray()
    for number, run in enumerate(runs, 1):
        rest = run
        while len(rest) >= _LONGEST_BLOCK:
            coded.append(_FULL)
            coded += rest[:_LONGEST_BLOCK]
            rest = rest[_LONGEST_BLOCK:]
        if rest or not run or number < len(runs):  # after a full block at the very end nothing is to be added
            coded.append(len(rest) + 1)
            coded += rest
    return bytes(coded)


def decode(coded: bytes) -> bytes:
    """The packet that was stuffed.

    Raises:
        CobsError: Empty, a zero byte within, or a code that points beyond the end.
    """
    if not coded or DELIMITER in coded:
        raise CobsError("a stuffed packet is empty, or has a zero byte in it")
    data = bytearray()
    begin = 0
    while True:
        code = coded[begin]
        end = begin + code
        if end > len(coded):
            raise CobsError(f"a code points {end - len(coded)} byte(s) beyond the end of a stuffed packet")
        data += coded[begin + 1 : end]
        if end == len(coded):
            return bytes(data)
        if code != _FULL:
            data += DELIMITER
        begin = end


class CobsReceiver:
    """Cuts a stream into packets at the zero bytes; whatever is broken ends at the next one."""

    def __init__(self, longest: int, refused: Counter[str]) -> None:
        """Take packets of up to `longest` stuffed bytes; count others in `refused` as `length` or `cobs`."""
        self._longest = longest
        self._refused = refused
        self._begun = bytearray()
        self._is_too_long = False

    def take_bytes(self, data: bytes) -> list[bytes]:
        """Take the next bytes of the stream, and return the packets that end in them, no longer stuffed."""
        *ended, begun = data.split(DELIMITER)
        packets = []
        for piece in ended:
            self._append(piece)
            coded, is_too_long = bytes(self._begun), self._is_too_long
            self.reset()
            if is_too_long:
                self._refused["length"] += 1
            elif coded:
                try:
                    packets.append(decode(coded))
                except CobsError:
                    self._refused["cobs"] += 1
        self._append(begun)
        return packets

    def reset(self) -> None:
        """Discard the packet that has begun."""
        self._begun.clear()
        self._is_too_long = False

    def _append(self, piece: bytes) -> None:
        if len(self._begun) + len(piece) > self._longest:
            self._is_too_long = True
        else:
            self._begun += piece
