# SPDX-License-Identifier: MIT
"""A log that goes on through everything a disk can do: in files of a size, within a quota, and past a full disk."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.codec import CYCLE, EVENTS, unpack_diagnostics
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import CycleLayout
from segway_ecc.node.recording.log_quota import LogQuota, part_path, remove_oldest_logs
from segway_ecc.node.recording.provenance import Provenance

_PARTS: Final = 9999


class BoundedLog:
    """Logs the messages of a run.

    While the disk refuses, messages are counted and dropped, and with each flush a new file is tried. A full disk is
    reported once, and again once there is room.

    Attributes:
        dropped: Messages that were not kept since the last file was opened.
    """

    def __init__(
        self, path: Path, layout: CycleLayout, provenance: Provenance, quota: LogQuota, report: Callable[[str], None]
    ) -> None:
        """Open the first file; `report` takes what people should know."""
        self.dropped = 0
        self._path = path
        self._layout = layout
        self._provenance = provenance
        self._quota = quota
        self._report = report
        self._number = 0
        self._file = path
        self._unflushed = 0
        self._log: CycleLog | None = None
        try:
            self._next()
        except RecordingError as error:
            self._lose(error)

    def write(self, kind: int, body: bytes) -> None:
        """Log one message."""
        self._unflushed += 1
        if self._log is None:
            return
        try:
            if kind == CYCLE:
                self._log.write_cycle(body)
            elif kind == EVENTS:
                self._log.write_events(body)
            else:
                diagnostics = unpack_diagnostics(body)
                self._log.write_diagnostics(diagnostics.stamp_ns, diagnostics.statuses)
        except RecordingError as error:
            self._lose(error)

    def flush(self) -> None:
        """Put everything onto the disk, begin the next file where it is time, and keep within the quota."""
        if self._log is None:
            # Begin a new file after a disk that refused; leave nothing where it still does.
            self.dropped += self._unflushed
            self._unflushed = 0
            try:
                self._next()
            except RecordingError:
                self._log = None
                if self._file.is_file():
                    self._file.unlink()
                self._number -= 1
                return
            self._report(f"the log goes on in {self._file}; {self.dropped} messages before it are missing")
            self.dropped = 0
            return
        try:
            self._log.flush()
            self._unflushed = 0
            remove_oldest_logs(self._path, self._quota, self._log.size, self._file)
            if self._log.size >= self._quota.file_bytes:
                self._log.close()
                self._next()
        except RecordingError as error:
            self._lose(error)

    def close(self) -> None:
        """Finish the log.

        Raises:
            RecordingError: The disk refuses, and the end of the log is missing.
        """
        if self._log is None:
            self.dropped += self._unflushed
            raise RecordingError(f"{self.dropped} messages at the end of the log {self._path} are missing")
        self._log.close()

    def _next(self) -> None:
        """Open the next file; its name and its beginning are on the disk when this returns."""
        self._number = min(self._number + 1, _PARTS)
        self._file = part_path(self._path, self._number)
        remove_oldest_logs(self._path, self._quota, 0, self._file)
        log = CycleLog(self._file, self._layout, self._provenance)
        self._log = log
        log.flush()
        with contextlib.suppress(OSError):  # some file systems cannot; the name then comes with the file's content
            folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def _lose(self, error: RecordingError) -> None:
        """Do without the present file."""
        self._log = None
        self._report(str(error))
