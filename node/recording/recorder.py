"""The loop's side of the recorder: hands each cycle to a process of its own and never waits for it."""

import contextlib
import fcntl
import logging
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from node.cycle.seams import CycleRecord
from node.cycle.status import Status
from node.errors import RecordingError
from node.recording.bounds import Bounds
from node.recording.codec import ATOMIC_BYTES, CycleCodec, pack_diagnostics
from node.recording.layout import Layout
from node.recording.provenance import NO_PROVENANCE, Provenance
from node.recording.writer import Job

_PIPE_BYTES: Final = 1 << 20
_CLOSE_S: Final = 10.0
_logger = logging.getLogger(__name__)


class ProcessRecorder:
    """See `node.cycle.seams.Recorder`.

    Attributes:
        dropped: Messages that were not kept, because the writer did not keep up or is gone.
    """

    def __init__(
        self, path: Path, layout: Layout, provenance: Provenance = NO_PROVENANCE, bounds: Bounds | None = None
    ) -> None:
        """Start the writer.

        Raises:
            RecordingError: The log cannot be written, or a cycle of this robot is too large for it.
        """
        self.dropped = 0
        self._path = path
        self._codec = CycleCodec(layout)
        if self._codec.size > ATOMIC_BYTES:
            raise RecordingError(
                f"a cycle of robot '{layout.robot}' takes {self._codec.size} bytes, and the recorder takes "
                f"{ATOMIC_BYTES} at most: it has too many signals and ports; run it with --no-log"
            )
        _check_writable(path)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "node.recording.writer"], stdin=subprocess.PIPE, start_new_session=True
        )
        assert self._process.stdin is not None  # noqa: S101 - it was asked for a line ago
        self._pipe = self._process.stdin.fileno()
        job = msgspec.json.encode(Job(str(path), layout, provenance, bounds or Bounds()))
        self._process.stdin.write(job + b"\n")
        self._process.stdin.flush()
        with contextlib.suppress(OSError):  # a smaller pipe only drops sooner
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.set_blocking(self._pipe, False)

    def write(self, record: CycleRecord) -> None:
        """Hand over a cycle; one that finds no room is dropped and counted.

        Raises:
            RecordingError: The writer is gone, which is worth telling once.
        """
        for frame in self._codec.pack(record):
            self._send(frame)

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[Status]) -> None:
        """Hand over diagnostics, one status at a time so that each fits whole; see `write`."""
        for status in statuses:
            self._send(pack_diagnostics(stamp_ns, (status,)))

    def close(self) -> None:
        """Let the writer finish the log."""
        with contextlib.suppress(OSError):
            os.set_blocking(self._pipe, True)
            self._process.stdin.close()  # type: ignore[union-attr]  # it was asked for when it was started
        try:
            status = self._process.wait(_CLOSE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            status = self._process.wait()
        if status != 0:
            _logger.warning("the recorder ended with status %d; the log %s may be incomplete", status, self._path)
        if self.dropped:
            _logger.warning("%d records are missing in the log %s", self.dropped, self._path)

    def _send(self, frame: bytes) -> None:
        if len(frame) > ATOMIC_BYTES:
            self.dropped += 1
            return
        try:
            os.write(self._pipe, frame)
        except BlockingIOError:  # the writer does not keep up
            self.dropped += 1
        except OSError as error:
            self.dropped += 1
            raise RecordingError(f"the process that writes the log {self._path} is gone") from error


def _check_writable(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb"):
            pass
    except OSError as error:
        reason = "a folder on the way is a file" if isinstance(error, FileExistsError) else error.strerror
        raise RecordingError(f"cannot write the log {path}: {reason}; choose another with --log") from error
