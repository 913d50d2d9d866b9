# SPDX-License-Identifier: MIT
"""The loop's side of the recorder: hands each cycle to a process of its own and never waits for it."""

import contextlib
import importlib
import logging
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.helper import end_helper, send_task, start_helper
from segway_ecc.node.recording.codec import (
    CYCLE,
    DIAGNOSTICS,
    STATE,
    CycleCodec,
    RecorderSettings,
    RunEnd,
    pack_cycle,
    pack_diagnostics,
    pack_state,
)
from segway_ecc.node.recording.cycle_message import CYCLE_TOPIC, cycle_of
from segway_ecc.node.recording.layout import NO_PROVENANCE, CycleLayout, Provenance
from segway_ecc.node.recording.log_quota import LogQuota, part_paths
from segway_ecc.node.ring import LARGEST, RingWriter, open_ring, slots_for

_CLOSE_S: Final = 10.0
_BUSY_NS: Final = 5_000_000_000
"""So long a disk may be busy: the ring has room for the cycles of it, 256 to 1,024, and what comes once a second."""
_FEWEST: Final = 256
_MOST: Final = 1024
_DIAGNOSTICS_BYTES: Final = 65_536
_logger = logging.getLogger(__name__)


class ProcessRecorder:
    """See `cycle.interfaces.Recorder`; counts messages `dropped`, because the writer did not keep up or is gone."""

    __slots__ = ("_buffer", "_last_cycle", "_path", "_process", "_ring", "dropped")

    def __init__(
        self, path: Path, layout: CycleLayout, provenance: Provenance = NO_PROVENANCE, bounds: LogQuota | None = None
    ) -> None:
        """Start the writer.

        Raises:
            RecordingError: The log cannot be written, or a cycle of this robot is too large for it.
        """
        self.dropped = 0
        self._last_cycle: int | None = None
        self._path = path
        size = CycleCodec(layout).size
        if size > LARGEST:
            raise RecordingError(
                f"a cycle of robot '{layout.robot}' takes {size} bytes, and the recorder takes "
                f"{LARGEST} at most: it has too many signals and ports; run it with --no-log"
            )
        if older := part_paths(path)[1:]:  # which would be overwritten, or removed for room
            raise RecordingError(
                f"cannot write the log {path}: {older[0].name}, a later file of an older log, is there; remove or move "
                "the older log, or choose another with --log"
            )
        if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe would have us wait for its reader
            raise RecordingError(f"cannot write the log {path}: it is no file; choose another with --log")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.open("wb").close()
        except OSError as error:
            reason = "a folder on the way is a file" if isinstance(error, FileExistsError) else error.strerror
            raise RecordingError(f"cannot write the log {path}: {reason}; choose another with --log") from error
        self._buffer = bytearray(size)
        cycles = min(max(_BUSY_NS // layout.period_ns, _FEWEST), _MOST) if layout.period_ns else _MOST
        memory = open_ring(cycles * slots_for(size) + slots_for(_DIAGNOSTICS_BYTES) + slots_for(LARGEST))
        try:
            self._ring = RingWriter(memory)
            self._process = start_helper("segway_ecc.node.recording.writer", (str(memory),), (memory,))
        finally:
            os.close(memory)
        try:
            send_task(self._process, RecorderSettings(str(path), layout, provenance, bounds or LogQuota()))
        except BrokenPipeError:
            status = end_helper(self._process, _CLOSE_S)
            raise RecordingError(
                f"cannot write the log {path}: the process that writes it ended as it started, with status {status}"
            ) from None

    def write(self, record: CycleRecord) -> None:
        """Hand over a cycle; one that finds no room is dropped and counted."""
        buffer, self._last_cycle = self._buffer, record.cycle
        pack_cycle(record, buffer)
        if not self._ring.put(CYCLE, buffer):
            self.dropped += 1

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Hand over diagnostics, one status at a time so that each is small; see `write`.

        Raises:
            RecordingError: The writer is gone, which is worth one message.
        """
        # Asked here, about once a second in the slack of a cycle, because handing over does not show it.
        if self._process.poll() is not None:
            raise RecordingError(f"the process that writes the log {self._path} is gone")
        for status in statuses:
            if not self._ring.put(DIAGNOSTICS, pack_diagnostics(stamp_ns, (status,))):
                self.dropped += 1

    def write_state(self, take: Callable[[], Snapshot]) -> None:
        """Hand over a snapshot; one that finds no room is not counted, since nothing of the run is in it alone."""
        self._ring.put(STATE, pack_state(take()))

    def close(self) -> None:
        """Let the writer finish the log."""
        with contextlib.suppress(BrokenPipeError):  # it is gone, which its status reports
            send_task(self._process, RunEnd(self.dropped, self._last_cycle))
        status = end_helper(self._process, _CLOSE_S)
        if status != 0:
            _logger.warning("the recorder ended with status %d; the log %s may be incomplete", status, self._path)
        self.dropped += self._ring.held()
        if status != 0 and self._last_cycle is not None:
            self._report_lost(self._last_cycle)
        elif self.dropped:
            _logger.warning("%d records are missing in the log %s", self.dropped, self._path)

    def _report_lost(self, last: int) -> None:
        """Count what a writer that failed did not write, also of what it had taken: the log itself tells."""
        kept = _newest_cycle(self._path)
        self.dropped = max(self.dropped, last - kept)
        if last > kept:
            text = "at least %d records are missing in the log %s: cycles %d to %d, and what came with them"
            _logger.warning(text, self.dropped, self._path, kept + 1, last)
        elif self.dropped:
            _logger.warning("%d records are missing in the log %s", self.dropped, self._path)


def _newest_cycle(path: Path) -> int:
    """The number of the last cycle that is whole in a log's files; -1 where there is none."""
    salvage = importlib.import_module("segway_ecc.node.recording.salvage")  # which a loop whose log is well never needs
    for part in reversed(part_paths(path)):
        with contextlib.suppress(RecordingError):
            message = salvage.Salvage(part).newest(CYCLE_TOPIC)
            if message is not None:
                return cycle_of(message.data)
    return -1
