"""A cycle as bytes, on its way from the loop to the process that writes the log.

A cycle passes as the message that the log holds: the writer passes it on as it is. What happened in it passes as
MessagePack, which takes the loop the least, and becomes a message in the writer.
"""

import struct
from collections.abc import Sequence
from typing import Final

import msgspec

from node.cycle.seams import CycleRecord
from node.cycle.status import Status
from node.recording import cdr
from node.recording.cycle_message import CycleMessage
from node.recording.happenings import Piece, happenings, texts
from node.recording.layout import Layout

FRAME_HEADER: Final = struct.Struct("<cI")
"""Kind and length of what follows."""
CYCLE: Final = b"C"
EVENTS: Final = b"E"
DIAGNOSTICS: Final = b"D"

ATOMIC_BYTES: Final = 4096
"""PIPE_BUF of Linux: what is not longer is written to a pipe whole or not at all (pipe(7))."""
_encode: Final = msgspec.msgpack.Encoder().encode
_decode: Final = msgspec.msgpack.Decoder(tuple[int, int, list[list[object]]]).decode


class DiagnosticsMessage(msgspec.Struct, frozen=True):
    """A set of diagnostics with its stamp, ns since the Unix epoch."""

    stamp_ns: int
    statuses: tuple[Status, ...]


class CycleCodec:
    """Packs the cycles of one robot.

    Attributes:
        message: The message of a cycle, which always has the same size.
    """

    def __init__(self, layout: Layout) -> None:
        """Make the codec for a layout."""
        self.message = CycleMessage(layout)
        self._header = FRAME_HEADER.pack(CYCLE, self.message.size)

    @property
    def size(self) -> int:
        """Of the frame of a cycle in which nothing happened, bytes."""
        return FRAME_HEADER.size + self.message.size

    def messages(self, record: CycleRecord) -> tuple[bytes | None, bytes]:
        """What happened in a cycle, as a message where anything did, and the cycle itself."""
        pieces = happenings(record)
        events = cdr.cycle_events(record.stamp_ns, record.cycle, texts(pieces)) if pieces else None
        return events, self.message.pack(record, len(pieces))

    def pack(self, record: CycleRecord) -> list[bytes]:
        """A cycle as frames, in pieces that a pipe takes whole; a cycle comes after what happened in it."""
        pieces = happenings(record)
        last = self._header + self.message.pack(record, len(pieces))
        if not pieces:
            return [last]
        *frames, frame = _events(record.stamp_ns, record.cycle, pieces)
        return [*frames, frame + last] if len(frame) + len(last) <= ATOMIC_BYTES else [*frames, frame, last]


def _events(stamp_ns: int, cycle: int, pieces: Sequence[Piece]) -> list[bytes]:
    """Frames that fit a pipe, unless one piece alone does not."""
    body = _encode((stamp_ns, cycle, pieces))
    if len(pieces) > 1 and len(body) + FRAME_HEADER.size > ATOMIC_BYTES:
        half = len(pieces) // 2
        return [*_events(stamp_ns, cycle, pieces[:half]), *_events(stamp_ns, cycle, pieces[half:])]
    return [FRAME_HEADER.pack(EVENTS, len(body)) + body]


def events_message(body: bytes) -> bytes:
    """The message that the body of a frame of events becomes."""
    stamp_ns, cycle, pieces = _decode(body)
    return cdr.cycle_events(stamp_ns, cycle, texts(pieces))


def pack_diagnostics(stamp_ns: int, statuses: Sequence[Status]) -> bytes:
    """Diagnostics as a frame."""
    body = msgspec.msgpack.encode(DiagnosticsMessage(stamp_ns, tuple(statuses)))
    return FRAME_HEADER.pack(DIAGNOSTICS, len(body)) + body


def unpack_diagnostics(body: bytes) -> DiagnosticsMessage:
    """The diagnostics in the body of a frame."""
    return msgspec.msgpack.decode(body, type=DiagnosticsMessage)
