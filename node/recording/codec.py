"""A cycle as bytes, on its way from the loop to the process that writes the log.

It passes as MessagePack of nearly everything as it lies, made in one call: in a loop that sleeps between its cycles the
caches are cold, and each further function, of Python or of C, takes some microseconds. The writer makes of it what the
log holds. MessagePack's own limits are those of the log: 64 bits for numbers of both kinds.
"""

import math
import struct
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import msgspec

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.seams import (
    PHASES,
    CycleRecord,
    HardwareAnswer,
    Heartbeat,
    Inbox,
    Request,
    SetValue,
    StampedSetpoint,
    Written,
)
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.status import Status
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording import cdr
from segway_ecc.node.recording.cycle_message import CycleMessage
from segway_ecc.node.recording.events import discard_answer, encode_events, events_of
from segway_ecc.node.recording.layout import CycleLayout
from segway_ecc.node.recording.log_quota import LogQuota
from segway_ecc.node.recording.provenance import Provenance
from segway_ecc.node.safety.modes import Action, Mode

CYCLE: Final = ord("C")
EVENTS: Final = ord("E")
DIAGNOSTICS: Final = ord("D")

Message = tuple[int, bytes]
"""Its kind, and its body."""


def _known(value: Any) -> float | None:  # noqa: ANN401 - whatever MessagePack does not know
    """A number of another library as a number; nobody for who asks."""
    return None if callable(value) else float(value)


_encoder: Final = msgspec.msgpack.Encoder(enc_hook=_known)
_encode: Final = _encoder.encode
_encode_into: Final = _encoder.encode_into
_NOTHING: Final = Inbox()
_INT64: Final = 2**63 - 1


class RecorderSettings(msgspec.Struct, frozen=True):
    """What the writer's process receives first, as one line of JSON.

    Attributes:
        path: The log to write.
        layout: Names of what each cycle holds.
        provenance: Where the run comes from.
        bounds: How much disk space it may take.
    """

    path: str
    layout: CycleLayout
    provenance: Provenance
    bounds: LogQuota


class DiagnosticsMessage(msgspec.Struct, frozen=True, array_like=True):
    """A set of diagnostics with its stamp, ns since the Unix epoch."""

    stamp_ns: int
    statuses: tuple[Status, ...]


class _Packed(NamedTuple):
    """A cycle as it passes."""

    cycle: int
    stamp_ns: int
    mode: Mode
    lateness_ns: int
    setpoint: Sequence[Any]
    u: Sequence[Any]
    y: Sequence[Any]
    commands: Sequence[Any]
    published: Sequence[Any]
    durations_ns: Sequence[int]
    start_ns: int
    values: Sequence[Any]
    ages: Sequence[Any]
    faults: tuple[str, ...]
    events: tuple[str, ...]
    setpoints: list[StampedSetpoint]
    set_values: list[SetValue]
    requests: list[tuple[Action, None]]
    written: list[Written]
    stations: list[Heartbeat]
    answers: list[HardwareAnswer]
    initial: Sensors | None
    valid: Sequence[Any]
    off: bool
    ready: bool


_decode_cycle: Final = msgspec.msgpack.Decoder(_Packed).decode


def pack_cycle(record: CycleRecord, buffer: bytearray) -> None:
    """Fill `buffer` with a cycle, in the order of `_Packed`."""
    (
        cycle,
        stamp_ns,
        mode,
        lateness_ns,
        sensors,
        setpoint,
        u,
        y,
        commands,
        published,
        durations_ns,
        start_ns,
        inbox,
        answers,
        initial,
    ) = record
    if inbox is None:
        inbox = _NOTHING
    _encode_into(
        (
            cycle,
            stamp_ns,
            mode,
            lateness_ns,
            setpoint,
            u,
            y,
            commands,
            published,
            durations_ns,
            start_ns,
            sensors.values,
            sensors.ages,
            sensors.faults,
            sensors.events,
            inbox.setpoints,
            inbox.values,
            inbox.requests,
            inbox.written,
            inbox.stations,
            answers,
            initial,
            sensors.valid,
            sensors.off,
            sensors.ready,
        ),
        buffer,
    )


def unpack_cycle(body: bytes) -> CycleRecord:
    """A cycle from its body."""
    packed = _decode_cycle(body)
    return CycleRecord(
        packed.cycle,
        packed.stamp_ns,
        packed.mode,
        packed.lateness_ns,
        Sensors(
            tuple(packed.values),
            tuple(packed.ages),
            tuple(packed.valid),
            packed.faults,
            ready=packed.ready,
            events=packed.events,
            off=packed.off,
        ),
        Setpoint(*packed.setpoint),
        packed.u,
        packed.y,
        packed.commands,
        packed.published,
        packed.durations_ns,
        packed.start_ns,
        Inbox(
            packed.setpoints,
            packed.set_values,
            [Request(action, discard_answer) for action, _ in packed.requests],
            packed.written,
            packed.stations,
        ),
        packed.answers,
        packed.initial,
    )


def pack_diagnostics(stamp_ns: int, statuses: Sequence[Status]) -> bytes:
    """Diagnostics as a body."""
    return _encode(DiagnosticsMessage(stamp_ns, tuple(statuses)))


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
        """Make the codec for a layout."""
        self.message = CycleMessage(layout)
        self.size = _largest(layout)

    def messages(self, record: CycleRecord) -> tuple[bytes | None, bytes]:
        """What happened in a cycle, as a message where anything did, and the cycle itself."""
        pieces = events_of(record)
        events = cdr.cycle_events(record.stamp_ns, record.cycle, encode_events(pieces)) if pieces else None
        return events, self.message.pack(record, len(pieces))

    def bodies(self, kind: int, body: bytes) -> list[Message]:
        """What the log takes in place of a message of the loop: all that happened in a cycle comes before it.

        Raises:
            RecordingError: It is no message of this robot's loop.
        """
        try:
            if kind == CYCLE:
                return self._cycle(body)
            if kind == DIAGNOSTICS:
                unpack_diagnostics(body)
                return [(kind, body)]
        except (msgspec.DecodeError, struct.error, TypeError, ValueError) as error:
            raise RecordingError(f"a record on its way to the log was damaged: {error}") from error
        raise RecordingError(f"a record on its way to the log was damaged: it is of no kind that there is, {kind}")

    def _cycle(self, body: bytes) -> list[Message]:
        events, cycle = self.messages(unpack_cycle(body))
        return [(CYCLE, cycle)] if events is None else [(EVENTS, events), (CYCLE, cycle)]


def _largest(layout: CycleLayout) -> int:
    sensors, inputs, outputs, commands, published = (
        (math.nan,) * len(names)
        for names in (layout.sensors, layout.inputs, layout.outputs, layout.commands, layout.published)
    )
    snapshot = Sensors(sensors, sensors, (True,) * len(sensors))
    record = CycleRecord(
        _INT64,
        _INT64,
        max(Mode, key=len),
        _INT64,
        snapshot,
        Setpoint(math.nan, math.nan),
        inputs,
        outputs,
        commands,
        published,
        (_INT64,) * (len(PHASES) - 1),
        _INT64,
    )
    buffer = bytearray()
    pack_cycle(record, buffer)
    return len(buffer)
