"""A cycle as bytes, on its way from the loop to the process that writes the log."""

import struct
from collections.abc import Sequence
from itertools import islice
from typing import Final

import msgspec

from firmware_io.hardware import Sensors
from node.cycle.cycle import PHASES
from node.cycle.seams import CycleRecord
from node.cycle.setpoints import Setpoint
from node.cycle.status import Status
from node.recording.cycle_log import Layout
from node.safety.modes import Mode

FRAME_HEADER: Final = struct.Struct("<cI")
"""Kind and length of what follows."""
CYCLE: Final = b"C"
DIAGNOSTICS: Final = b"D"
_MODES: Final = tuple(Mode)
_MODE_INDEX: Final = {mode: index for index, mode in enumerate(_MODES)}


class DiagnosticsMessage(msgspec.Struct, frozen=True):
    """A set of diagnostics with its stamp, ns since the Unix epoch."""

    stamp_ns: int
    statuses: tuple[Status, ...]


class CycleCodec:
    """Packs the cycles of one robot, which all have the same size, and unpacks them again."""

    def __init__(self, layout: Layout) -> None:
        """Make the codec for a layout."""
        self._counts = (
            2,
            len(layout.published),
            len(layout.sensors),
            len(layout.sensors),
            len(layout.inputs),
            len(layout.outputs),
            len(layout.commands),
        )
        self._struct = struct.Struct(f"<qqBq{len(PHASES) - 1}q{sum(self._counts)}d")

    def pack(self, record: CycleRecord) -> bytes:
        """A cycle as a frame."""
        body = self._struct.pack(
            record.cycle,
            record.stamp_ns,
            _MODE_INDEX[record.mode],
            record.lateness_ns,
            *record.durations_ns,
            *record.setpoint,
            *record.published,
            *record.sensors.values,
            *record.sensors.ages,
            *record.u,
            *record.y,
            *record.commands,
        )
        return FRAME_HEADER.pack(CYCLE, len(body)) + body

    def unpack(self, body: bytes) -> CycleRecord:
        """The cycle in the body of a frame; which sensors were valid, faults, readiness and events are not kept."""
        cycle, stamp_ns, mode, lateness_ns, *rest = self._struct.unpack(body)
        numbers = iter(rest)
        durations_ns = list(islice(numbers, len(PHASES) - 1))
        setpoint, published, values, ages, u, y, commands = (tuple(islice(numbers, n)) for n in self._counts)
        return CycleRecord(
            cycle,
            stamp_ns,
            _MODES[mode],
            lateness_ns,
            Sensors(values, ages, ()),
            Setpoint(*setpoint),
            u,
            y,
            commands,
            published,
            durations_ns,
        )


def pack_diagnostics(stamp_ns: int, statuses: Sequence[Status]) -> bytes:
    """Diagnostics as a frame."""
    body = msgspec.msgpack.encode(DiagnosticsMessage(stamp_ns, tuple(statuses)))
    return FRAME_HEADER.pack(DIAGNOSTICS, len(body)) + body


def unpack_diagnostics(body: bytes) -> DiagnosticsMessage:
    """The diagnostics in the body of a frame."""
    return msgspec.msgpack.decode(body, type=DiagnosticsMessage)
