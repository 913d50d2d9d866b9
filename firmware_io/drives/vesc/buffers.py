# SPDX-License-Identifier: MIT
"""Packets of the VESC's serial protocol carried in CAN frames: a short one in one frame, a longer one in several.

A controller that processes such a packet sends its reply, in the same way, to the identifier of the sender.
Source: as for `frames`; a packet of up to six bytes is PROCESS_SHORT_BUFFER [sender, mode, packet], a longer one
FILL_RX_BUFFER [offset, 7 bytes] until all is sent, from offset 256 on FILL_RX_BUFFER_LONG [offset, 6 bytes], and then
PROCESS_RX_BUFFER [sender, mode, length, CRC-16].
"""

import enum
import struct
from typing import Final, NamedTuple

from segway_ecc.firmware_io.drives.vesc.frames import PacketId, arbitration_id
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal, crc16_xmodem
from segway_ecc.firmware_io.links.link import Frame

SHORT_BYTES: Final = 6
"""A packet of up to this many bytes fits one frame."""
MAX_BYTES: Final = 512
"""The longest packet that a controller takes."""

_HEAD: Final = 2
_SHORT_OFFSETS: Final = 256
_FILL: Final = 7
_FILL_LONG: Final = 6
_PROCESS: Final = struct.Struct(">BBHH")


@enum.unique
class Mode(enum.IntEnum):
    """What the receiver does with a packet."""

    PROCESS = 0
    """Obey it, and reply to the sender."""
    PASS_ON = 1
    """It is a reply: hand it to whoever asked."""
    PROCESS_SILENTLY = 2


class ShortBuffer(NamedTuple):
    """A packet of 1 to 6 bytes from a sender."""

    sender_id: int
    mode: Mode
    packet: bytes


def decode_short(data: bytes) -> ShortBuffer:
    """The packet in the data of a PROCESS_SHORT_BUFFER frame.

    Raises:
        FrameRefusedError: There is no packet in it, it is too long, or its mode is not known.
    """
    if not _HEAD < len(data) <= _HEAD + SHORT_BYTES:
        raise FrameRefusedError(Refusal.LENGTH, f"PROCESS_SHORT_BUFFER of {len(data)} bytes")
    try:
        return ShortBuffer(data[0], Mode(data[1]), data[_HEAD:])
    except ValueError as error:
        raise FrameRefusedError(Refusal.RANGE, f"PROCESS_SHORT_BUFFER with mode {data[1]}") from error


def frames_of(receiver_id: int, sender_id: int, mode: Mode, packet: bytes) -> list[Frame]:
    """The frames that carry a packet to a receiver.

    Raises:
        FrameRefusedError: The packet is empty or too long.
    """
    if not 0 < len(packet) <= MAX_BYTES:
        raise FrameRefusedError(Refusal.LENGTH, f"packet of {len(packet)} bytes")
    if len(packet) <= SHORT_BYTES:
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


def _frame(command: PacketId, receiver_id: int, data: bytes) -> Frame:
    return Frame(arbitration_id(command, receiver_id), data, is_extended=True)
