# SPDX-License-Identifier: MIT
"""The framing of the VESC's packets: on a serial line, with a receiver that finds good ones among anything, and on CAN.

On the line a packet of up to 255 bytes is 0x02, its length in one byte, the packet, its CRC-16/XMODEM, 0x03; a longer
one begins with 0x03 and its length in two bytes. On CAN one of up to six bytes is PROCESS_SHORT_BUFFER [sender, mode,
packet], a longer one FILL_RX_BUFFER [offset, 7 bytes] until all is sent, from offset 256 on FILL_RX_BUFFER_LONG
[offset, 6 bytes], and then PROCESS_RX_BUFFER [sender, mode, length, CRC-16]; the reply comes in the same way, to the
identifier of the sender. Source: as for `frames`.
"""

import enum
import struct
from collections import Counter
from collections.abc import Iterator
from typing import Final, NamedTuple

from segway_ecc.firmware_io.drives.vesc.frames import PacketId, arbitration_id
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal, crc16_xmodem
from segway_ecc.firmware_io.links.link import Frame

MAX_PACKET: Final = 512
"""The longest packet that a controller takes, bytes."""
_SHORT_START: Final = b"\x02"
_LONG_START: Final = b"\x03"
_LONG_HEAD: Final = 3
_STOP: Final = 0x03
_MAX_SHORT: Final = 0xFF
_TRAILER: Final = 3  # CRC and stop byte
_LONGEST: Final = _LONG_HEAD + MAX_PACKET + _TRAILER

_SHORT_BYTES: Final = 6
"""A packet of up to this many bytes fits one CAN frame."""
_BUFFER_HEAD: Final = 2
_SHORT_OFFSETS: Final = 256
_FILL: Final = 7
_FILL_LONG: Final = 6
_PROCESS: Final = struct.Struct(">BBHH")


def frame_packet(packet: bytes) -> bytes:
    """A packet with its framing; FrameRefusedError where it is empty or longer than 512 bytes."""
    if not 0 < len(packet) <= MAX_PACKET:
        raise FrameRefusedError(Refusal.LENGTH, f"packet of {len(packet)} bytes")
    if len(packet) <= _MAX_SHORT:
        head = _SHORT_START + bytes((len(packet),))
    else:
        head = _LONG_START + len(packet).to_bytes(2, "big")
    return head + packet + crc16_xmodem(packet).to_bytes(2, "big") + bytes((_STOP,))


class PacketReceiver:
    """Finds packets in a stream of bytes that comes in pieces of any size.

    Every byte that could begin a packet is followed up on its own, so that a false beginning hides nothing behind it,
    and a packet that seems to lie within another one does not hide that: the CRC of a run of zeros is zero, so that
    `02 01 00 00 00 03` may well stand among the values of a longer packet. Both are given out, each when its last byte
    comes; their contents distinguish them. What is kept is bounded by the longest packet. `refused` counts packets
    received and not taken, by cause; `garbage` in it, stretches of half a kilobyte without any.
    """

    __slots__ = ("_dropped", "_ends", "_good_to", "_kept", "refused")

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self._kept = bytearray()
        self._dropped = 0
        """Bytes that came before those kept; places are counted from there, so that they never move."""
        self._ends: dict[int, list[int]] = {}
        """For each place where packets may end, where what they carry begins."""
        self._good_to = 0

    def reset(self) -> None:
        """Discard unfinished packets."""
        self._kept.clear()
        self._ends.clear()
        self._dropped = self._good_to = 0

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes, and return the packets that they complete, without their framing."""
        packets: list[bytes] = []
        for start in range(0, len(data), _LONGEST):
            known = len(self._kept)
            self._kept += data[start : start + _LONGEST]
            self._begin(known)
            packets += self._finish()
            # What can no longer be part of a packet is discarded, some at a time.
            while len(self._kept) > 2 * _LONGEST:
                del self._kept[:_LONGEST]
                if self._good_to <= self._dropped:
                    self.refused["garbage"] += 1
                self._dropped += _LONGEST
        return packets

    def _begin(self, known: int) -> None:
        """Note the packets whose heads are complete only with what comes after the first `known` bytes."""
        kept = self._kept
        for place in self._places(_SHORT_START, known - 1, len(kept) - 1):
            if kept[place + 1] > 0:
                self._expect(place + 2, kept[place + 1])
        for place in self._places(_LONG_START, known - 2, len(kept) - 2):
            length = kept[place + 1] << 8 | kept[place + 2]
            if _MAX_SHORT < length <= MAX_PACKET:
                self._expect(place + _LONG_HEAD, length)

    def _places(self, byte: bytes, start: int, stop: int) -> Iterator[int]:
        place = self._kept.find(byte, max(start, 0), max(stop, 0))
        while place >= 0:
            yield place
            place = self._kept.find(byte, place + 1, stop)

    def _expect(self, body: int, length: int) -> None:
        begun = self._dropped + body
        self._ends.setdefault(begun + length + _TRAILER, []).append(begun)

    def _finish(self) -> list[bytes]:
        """The packets whose last byte is there, in the order of their ends."""
        packets: list[bytes] = []
        received = self._dropped + len(self._kept)
        for end in sorted(end for end in self._ends if end <= received):
            found = [self._check(body - self._dropped, end - self._dropped) for body in sorted(self._ends.pop(end))]
            if any(found):
                self._good_to = end
            packets += filter(None, found)
        return packets

    def _check(self, body: int, end: int) -> bytes | None:
        """The packet between two places; None where there is none after all."""
        if self._kept[end - 1] != _STOP:
            return None
        packet = bytes(self._kept[body : end - _TRAILER])
        if crc16_xmodem(packet) == int.from_bytes(self._kept[end - _TRAILER : end - 1], "big"):
            return packet
        self.refused[Refusal.CRC] += 1
        return None


@enum.unique
class Mode(enum.IntEnum):
    """What the receiver does with a packet."""

    PROCESS = 0
    """Obey it, and reply to the sender."""
    PASS_ON = 1
    """It is a reply: hand it to whoever asked."""
    PROCESS_SILENTLY = 2


class ShortBuffer(NamedTuple):
    """A packet from a sender; of 1 to 6 bytes where one frame carried it."""

    sender_id: int
    mode: Mode
    packet: bytes


def decode_short(data: bytes) -> ShortBuffer:
    """The packet in the data of a PROCESS_SHORT_BUFFER frame.

    Raises:
        FrameRefusedError: There is no packet in it, it is too long, or its mode is not known.
    """
    if not _BUFFER_HEAD < len(data) <= _BUFFER_HEAD + _SHORT_BYTES:
        raise FrameRefusedError(Refusal.LENGTH, f"PROCESS_SHORT_BUFFER of {len(data)} bytes")
    try:
        return ShortBuffer(data[0], Mode(data[1]), data[_BUFFER_HEAD:])
    except ValueError as error:
        raise FrameRefusedError(Refusal.RANGE, f"PROCESS_SHORT_BUFFER with mode {data[1]}") from error


def frames_of(receiver_id: int, sender_id: int, mode: Mode, packet: bytes) -> list[Frame]:
    """The frames that carry a packet to a receiver; FrameRefusedError where it is empty or too long."""
    if not 0 < len(packet) <= MAX_PACKET:
        raise FrameRefusedError(Refusal.LENGTH, f"packet of {len(packet)} bytes")
    if len(packet) <= _SHORT_BYTES:
        return [_frame(PacketId.PROCESS_SHORT_BUFFER, receiver_id, bytes((sender_id, mode)) + packet)]
    frames = []
    offset = 0
    while offset < len(packet):
        is_long = offset >= _SHORT_OFFSETS
        end = offset + (_FILL_LONG if is_long else _FILL)
        command = PacketId.FILL_RX_BUFFER_LONG if is_long else PacketId.FILL_RX_BUFFER
        frames.append(_frame(command, receiver_id, offset.to_bytes(1 + is_long, "big") + packet[offset:end]))
        offset = end
    last = _PROCESS.pack(sender_id, mode, len(packet), crc16_xmodem(packet))
    return [*frames, _frame(PacketId.PROCESS_RX_BUFFER, receiver_id, last)]


class PacketAssembler:
    """Puts a long packet that comes on CAN together again, as `frames_of` takes it apart; one at a time."""

    __slots__ = ("_kept",)

    def __init__(self) -> None:
        self._kept = bytearray()

    def take(self, command: PacketId, data: bytes) -> ShortBuffer | None:
        """Take a frame of a packet; the packet with its sender, of any length, where that completes it.

        Raises:
            FrameRefusedError: A frame is too short, a part is missing, or length, mode or CRC is wrong.
        """
        if command is PacketId.PROCESS_RX_BUFFER:
            return self._finish(data)
        head = 1 if command is PacketId.FILL_RX_BUFFER else 2
        offset = int.from_bytes(data[:head], "big")
        if offset == 0:
            self._kept.clear()
        if len(data) <= head or offset != len(self._kept) or offset + len(data) - head > MAX_PACKET:
            self._kept.clear()
            raise FrameRefusedError(Refusal.LENGTH, f"{command.name} at {offset}")
        self._kept += data[head:]
        return None

    def _finish(self, data: bytes) -> ShortBuffer:
        packet = bytes(self._kept)
        self._kept.clear()
        if len(data) != _PROCESS.size:
            raise FrameRefusedError(Refusal.LENGTH, f"PROCESS_RX_BUFFER of {len(data)} bytes")
        sender_id, mode, length, crc = _PROCESS.unpack(data)
        if mode != Mode.PASS_ON:
            raise FrameRefusedError(Refusal.RANGE, f"PROCESS_RX_BUFFER with mode {mode}")
        if not packet or length != len(packet):
            raise FrameRefusedError(Refusal.LENGTH, f"packet of {len(packet)} bytes")
        if crc != crc16_xmodem(packet):
            raise FrameRefusedError(Refusal.CRC, "PROCESS_RX_BUFFER")
        return ShortBuffer(sender_id, Mode.PASS_ON, packet)


def _frame(command: PacketId, receiver_id: int, data: bytes) -> Frame:
    return Frame(arbitration_id(command, receiver_id), data, is_extended=True)
