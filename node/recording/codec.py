# SPDX-License-Identifier: MIT
"""A cycle as bytes, on its way from the loop to the process that writes the log.

It passes as MessagePack of the whole record, made in one call: in a loop that sleeps between its cycles the caches are
cold, and each further function, of Python or of C, takes some microseconds. The writer makes of it what the log holds.
MessagePack's own limits are those of the log: 64 bits for numbers of both kinds.
"""

import math
import struct
from collections.abc import Sequence
from typing import Any, Final, get_type_hints

import msgspec

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.interfaces import PHASES, CycleRecord, Inbox
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording import cdr
from segway_ecc.node.recording.cycle_message import CycleMessage, discard_answer, encode_events, events_of
from segway_ecc.node.recording.layout import CycleLayout, Provenance
from segway_ecc.node.recording.log_quota import LogQuota
from segway_ecc.node.safety.modes import Mode

CYCLE: Final = ord("C")
EVENTS: Final = ord("E")
DIAGNOSTICS: Final = ord("D")
STATE: Final = ord("S")


def _plain(value: Any) -> bool | float | None:  # noqa: ANN401 - whatever MessagePack does not know
    """A number of another library as Python's own; nothing for who waits for an answer."""
    if callable(value):
        return None
    return value.item() if hasattr(value, "item") else float(value)


_encoder: Final = msgspec.msgpack.Encoder(enc_hook=_plain)
_PACKED: Final = msgspec.defstruct(
    "_Packed",
    # A model may give whatever packs as a number, a truth value too.
    [(name, Sequence[Any] if kind == Sequence[float] else kind) for name, kind in get_type_hints(CycleRecord).items()],
    array_like=True,
)
_decode_cycle: Final = msgspec.msgpack.Decoder(_PACKED, dec_hook=lambda _kind, _value: discard_answer).decode
_INT64: Final = 2**63 - 1


class RecorderSettings(msgspec.Struct, frozen=True):
    """What the writer's process receives first, as one line of JSON: the log to write, and what it may hold."""

    path: str
    layout: CycleLayout
    provenance: Provenance
    bounds: LogQuota


class RunEnd(msgspec.Struct, frozen=True):
    """What the writer's process receives last, as one line of JSON: what the log may not have.

    Attributes:
        dropped: How many messages found no room in the ring.
        last_cycle: Number of the last cycle; None where there was none.
    """

    dropped: int
    last_cycle: int | None = None


class DiagnosticsMessage(msgspec.Struct, frozen=True, array_like=True):
    """A set of diagnostics with its stamp, ns since the Unix epoch."""

    stamp_ns: int
    statuses: tuple[DiagnosticStatus, ...]


pack_cycle: Final = _encoder.encode_into
"""Fills a buffer with a cycle: `pack_cycle(record, buffer)`."""


pack_state: Final = _encoder.encode
"""A snapshot as a body."""
unpack_state: Final = msgspec.msgpack.Decoder(Snapshot).decode
"""The snapshot in a body, or in what the log holds behind its header; msgspec.DecodeError where it is none."""


def state_message(snapshot: Snapshot) -> bytes:
    """A snapshot as the log holds it."""
    return cdr.state(snapshot.stamp_ns, snapshot.cycle, pack_state(snapshot))


def pack_diagnostics(stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> bytes:
    """Diagnostics as a body."""
    return _encoder.encode(DiagnosticsMessage(stamp_ns, tuple(statuses)))


def unpack_diagnostics(body: bytes) -> DiagnosticsMessage:
    """The diagnostics in a body."""
    return msgspec.msgpack.decode(body, type=DiagnosticsMessage)


class CycleCodec:
    """Makes the messages of one robot's log.

    Attributes:
        message: The message of a cycle, which always has the same size.
        size: Of a cycle on its way to the writer in which nothing happened, bytes at most.
    """

    def __init__(self, layout: CycleLayout) -> None:
        self.message = CycleMessage(layout)
        sensors, inputs, outputs, commands, published = (
            (math.nan,) * len(names)
            for names in (layout.sensors, layout.inputs, layout.outputs, layout.commands, layout.published)
        )
        largest = CycleRecord(
            _INT64,
            _INT64,
            max(Mode, key=len),
            _INT64,
            Sensors(sensors, sensors, (True,) * len(sensors)),
            Setpoint(math.nan, math.nan),
            inputs,
            outputs,
            commands,
            published,
            (_INT64,) * (len(PHASES) - 1),
            _INT64,
            Inbox(),
        )
        self.size = len(_encoder.encode(largest))

    def messages(self, record: CycleRecord) -> tuple[bytes | None, bytes]:
        """What happened in a cycle, as a message where anything did, and the cycle itself."""
        pieces = events_of(record)
        events = cdr.cycle_events(record.stamp_ns, record.cycle, encode_events(pieces)) if pieces else None
        return events, self.message.pack(record, len(pieces))

    def bodies(self, kind: int, body: bytes) -> list[tuple[int, bytes]]:
        """What the log takes in place of a message of the loop: all that happened in a cycle comes before it.

        Raises:
            RecordingError: It is no message of this robot's loop.
        """
        try:
            if kind == CYCLE:
                events, cycle = self.messages(CycleRecord(*msgspec.structs.astuple(_decode_cycle(body))))
                return [(CYCLE, cycle)] if events is None else [(EVENTS, events), (CYCLE, cycle)]
            if kind == DIAGNOSTICS:
                unpack_diagnostics(body)
                return [(kind, body)]
            if kind == STATE:
                return [(kind, state_message(unpack_state(body)))]
        except (msgspec.DecodeError, struct.error, TypeError, ValueError) as error:
            raise RecordingError(f"a record on its way to the log was damaged: {error}") from error
        raise RecordingError(f"a record on its way to the log was damaged: there is no kind {kind}")
