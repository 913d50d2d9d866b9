# SPDX-License-Identifier: MIT
"""The process that writes a run's log: its settings come through its standard input, the cycles through a ring."""

import contextlib
import itertools
import os
import select
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.node.errors import RecordingError
from segway_ecc.node.parent import signal_at_its_end
from segway_ecc.node.recording.codec import (
    CYCLE,
    EVENTS,
    STATE,
    CycleCodec,
    RecorderSettings,
    RunEnd,
    unpack_diagnostics,
)
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.cycle_message import cycle_of
from segway_ecc.node.recording.layout import LogPart
from segway_ecc.node.recording.log_quota import part_path, remove_oldest_logs
from segway_ecc.node.recording.mcap_log import MISSING
from segway_ecc.node.ring import RingReader

_PARTS: Final = 9999
_PAUSE_S: Final = 0.5
"""Between two looks, after each of which all goes to the disk: a power cut loses this much, and what one flush takes.

What was handed over is safe from anything else, and many at once cost less than each alone.
"""
_SHORT_PAUSE_S: Final = 0.01
_MANY: Final = 512
"""So many at one look, and the next comes sooner: memory is no larger for it."""
_READ_BYTES: Final = 65_536
_LOOKS: Final = 2
"""At the end: a ring looks twice at what does not look whole."""


class BoundedLog:
    """Logs the messages of a run through everything a disk can do: in files of a size, within a quota.

    While the disk refuses, messages are counted and dropped, and with each flush a new file is tried. A full disk is
    reported once, and again once there is room.

    Attributes:
        dropped: Messages that were not kept since the last file was opened.
        damaged: Messages that the ring held and that were none of this robot's loop.
    """

    def __init__(self, settings: RecorderSettings, report: Callable[[str], None]) -> None:
        """Open the first file; `report` takes what people should know."""
        self.dropped = self.damaged = 0
        self._codec = CycleCodec(settings.layout)
        self._settings = settings
        self._path = self._file = Path(settings.path)
        self._quota = settings.bounds
        self._report = report
        self._part = LogPart(number=0)
        self._unflushed = 0
        self._log: CycleLog | None = None
        self._last_cycle: int | None = None
        try:
            self._next()
        except RecordingError as error:
            self._lose(error)

    def keep_messages(self, ring: RingReader) -> int:
        """Log messages that have arrived, 512 at most; returns how many they were."""
        taken = 0
        for message in itertools.islice(ring.take_messages(), _MANY):
            taken += 1
            try:
                bodies = self._codec.bodies(*message)
            except RecordingError:
                self.damaged += 1
                continue
            for kind, body in bodies:
                self.write(kind, body)
        return taken

    def write(self, kind: int, body: bytes) -> None:
        """Log one message."""
        self._unflushed += 1
        if kind == CYCLE:
            self._last_cycle = cycle_of(body)
        if self._log is None:
            return
        try:
            if kind == CYCLE:
                self._log.write_cycle(body)
            elif kind == EVENTS:
                self._log.write_events(body)
            elif kind == STATE:
                self._log.write_snapshot(body)
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
                if self._file.is_file():
                    self._file.unlink()
                return
            self._report(f"the log goes on in {self._file}; {self.dropped} messages before it are missing")
            self.dropped = 0
            return
        try:
            self._log.flush()
            self._unflushed = 0
            remove_oldest_logs(self._path, self._quota, self._log.size, self._file)
            if self._log.size >= self._quota.file_bytes:
                self._log.close(is_end=False)
                self._next()
        except RecordingError as error:
            self._lose(error)

    def close(self, missing: int = 0, *, is_end: bool = True, last_cycle: int | None = None) -> None:
        """Finish the log; so many messages never reached it. It has an end unless the node was killed.

        The last cycle is the newest that came here, unless the loop knows of a later one.

        Raises:
            RecordingError: The disk refuses, and the end of the log is missing.
        """
        if self._log is None:
            self.dropped += self._unflushed
            raise RecordingError(f"{self.dropped} messages at the end of the log {self._path} are missing")
        if missing:
            self._log.metadata(MISSING, {"messages": str(missing)})
        self._log.close(is_end=is_end, last_cycle=self._last_cycle if last_cycle is None else last_cycle)

    def _next(self) -> None:
        """Open the next file; its name and its beginning are on the disk when this returns."""
        part = LogPart(self._part.run, min(self._part.number + 1, _PARTS))
        self._file = part_path(self._path, part.number)
        remove_oldest_logs(self._path, self._quota, 0, self._file)
        log = CycleLog(self._file, self._settings.layout, self._settings.provenance, part)
        log.flush()
        self._log, self._part = log, part
        with contextlib.suppress(OSError):  # some file systems cannot; the name then comes with the file's content
            folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def _lose(self, error: RecordingError) -> None:
        self._log = None
        self._report(str(error))


def write_log(source: int, memory: int) -> None:
    """Write the log that the first line of `source` describes from the messages in a ring.

    Args:
        source: A file descriptor, which ends when the loop has; unless the node was killed, a second line comes before,
            of what the loop lost.
        memory: That of the ring.

    Raises:
        RecordingError: The log cannot be written, or its end is missing.
    """
    received = b""
    while b"\n" not in received and (sent := os.read(source, _READ_BYTES)):
        received += sent
    line, _, end = received.partition(b"\n")
    settings = msgspec.json.decode(line, type=RecorderSettings)
    ring = RingReader(memory)
    log = BoundedLog(settings, _report)
    pause_s = _SHORT_PAUSE_S
    # Nobody waits at the ring: to wake who does would cost the loop more than all the rest of its part.
    while True:
        if select.select([source], [], [], pause_s)[0]:
            sent = os.read(source, _READ_BYTES)
            if not sent:
                break
            end += sent
        pause_s = _SHORT_PAUSE_S if log.keep_messages(ring) == _MANY else _PAUSE_S
        log.flush()
    looks_for_nothing = 0
    while looks_for_nothing < _LOOKS:
        looks_for_nothing += log.keep_messages(ring) == 0
    damaged = log.damaged + ring.damaged
    if damaged:
        _report(f"{damaged} records were damaged on their way and are missing in the log {settings.path}")
    told = msgspec.json.decode(end, type=RunEnd) if end else RunEnd(0)
    log.close(damaged + told.dropped, is_end=bool(end), last_cycle=told.last_cycle)


def _report(text: str) -> None:
    sys.stderr.write(f"segway-ecc: recorder: {text}\n")


def main() -> int:
    """Run as a process; the signals that end the loop leave it to finish the log."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    signal.signal(signal.SIGABRT, signal.SIG_IGN)  # how a service manager's watchdog ends all of a service
    # Continued when the node dies: a writer that is stopped just then would never see its input end.
    signal_at_its_end(signal.SIGCONT)
    try:
        write_log(sys.stdin.fileno(), int(sys.argv[1]))
    except RecordingError as error:
        _report(str(error))
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
