# SPDX-License-Identifier: MIT
"""The wheel board's serial line: each CAN frame as a packet of its own.

A packet, COBS-stuffed, with a zero byte before and after it, so that noise before it is not taken for a part of it:

    sequence u8 | identifier u16 | data, 0 to 8 bytes | CRC u16        little-endian

The sequence number counts the packets of one sender. The CRC is CRC-16/IBM-3740 (polynomial 0x1021, initial value
0xFFFF, nothing reflected or inverted) of all before it. Its initial value is not zero because a zero byte put before
the packet, or taken away from its beginning, would then not change the sum: one flipped bit of the stuffing does that.
"""

import struct
from collections import Counter
from typing import Final

from segway_ecc.firmware_io.integrity import Refusal, crc16_xmodem
from segway_ecc.firmware_io.links import cobs
from segway_ecc.firmware_io.links.cobs import CobsReceiver
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.serial_link import LOST

REQUEST_ID: Final = 0x7FE
"""Reserved: a packet with this identifier and no data asks for the newest telemetry."""

_MAX_ID: Final = 0x7FF
_MAX_DATA: Final = 8
_HEAD: Final = struct.Struct("<BH")
_CRC: Final = struct.Struct("<H")
_SHORTEST: Final = _HEAD.size + _CRC.size
_LONGEST: Final = _SHORTEST + _MAX_DATA
_STUFFING: Final = 1
_CRC_PRESET: Final = b"\x84\xcf"
"""Brings CRC-16/XMODEM to 0xFFFF, where CRC-16/IBM-3740 begins."""
_SEQUENCE: Final = 256


class BoardSerialCodec:
    """Packets from and to the board; see `SerialCodec`. Both ends use it.

    `refused` is what was received and not taken, by cause; under `LOST` packets missing by their sequence numbers.
    """

    def __init__(self) -> None:
        """Begin with nothing received."""
        self.refused: Counter[str] = Counter()
        self.requests = 0
        self._receiver = CobsReceiver(_LONGEST + _STUFFING, self.refused)
        self._next_sent = 0
        self._next_received: int | None = None

    def encode(self, frame: Frame) -> bytes | None:
        """A frame's packet; None for an extended or remote one, or one with the reserved identifier."""
        if frame.is_extended or frame.is_remote or frame.arbitration_id == REQUEST_ID:
            return None
        return self._packet(frame.arbitration_id, frame.data)

    def request(self) -> bytes:
        """The packet that asks the board for its newest telemetry: wheels, IMU and status."""
        return self._packet(REQUEST_ID, b"")

    def decode(self, data: bytes, now_ns: int) -> list[Frame]:
        """The frames whose packets end in `data`; see `SerialCodec.decode`. A request is counted, and is no frame."""
        frames = [self._take(packet, now_ns) for packet in self._receiver.take_bytes(data)]
        return [frame for frame in frames if frame is not None]

    def reset(self) -> None:
        """Discard the packet that has begun, and the sequence."""
        self._receiver.reset()
        self._next_received = None

    def _packet(self, identifier: int, data: bytes) -> bytes:
        body = _HEAD.pack(self._next_sent, identifier) + data
        self._next_sent = (self._next_sent + 1) % _SEQUENCE
        return cobs.DELIMITER + cobs.encode(body + _CRC.pack(_crc(body))) + cobs.DELIMITER

    def _take(self, packet: bytes, now_ns: int) -> Frame | None:
        cause = _fault(packet)
        if cause is not None:
            self.refused[cause] += 1
            return None
        sequence, identifier = _HEAD.unpack_from(packet)
        if self._next_received is not None:
            self.refused[LOST] += (sequence - self._next_received) % _SEQUENCE
        self._next_received = (sequence + 1) % _SEQUENCE
        if identifier == REQUEST_ID:
            self.requests += 1
            return None
        return Frame(identifier, packet[_HEAD.size : -_CRC.size], now_ns)


def _fault(packet: bytes) -> Refusal | None:
    """Why a packet must not be taken; None where it is whole."""
    if not _SHORTEST <= len(packet) <= _LONGEST:
        return Refusal.LENGTH
    body, crc = packet[: -_CRC.size], packet[-_CRC.size :]
    if _CRC.pack(_crc(body)) != crc:
        return Refusal.CRC
    _, identifier = _HEAD.unpack_from(body)
    if identifier > _MAX_ID:
        return Refusal.UNKNOWN
    if identifier == REQUEST_ID and len(packet) > _SHORTEST:
        return Refusal.LENGTH
    return None


def _crc(body: bytes) -> int:
    return crc16_xmodem(_CRC_PRESET + body)
