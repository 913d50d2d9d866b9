# SPDX-License-Identifier: MIT
"""Who did what, and what came of it: lines of JSON that are only ever appended.

A thread of its own writes them, so that a slow disk blocks nothing; a full one stops nothing and is logged once.
"""

import contextlib
import datetime as dt
import itertools
import logging
import os
import queue
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

NAME: Final = "audit.jsonl"
_MOST_BYTES: Final = 8 * 1024 * 1024
_KEPT: Final = 4
_MOST_WAITING: Final = 10_000
_ENDS_WITHIN_S: Final = 2.0
_LONGEST_TEXT: Final = 500
_logger = logging.getLogger(__name__)


class AuditEntry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One line.

    Attributes:
        time: When, UTC, as ISO 8601 writes it.
        role: As what.
        address: From where.
        act: What: one of `Act`, or `login`, `logout`, `drive`, `rest`, `bundle`, `log`, `fetch`, `starts`, `ends`.
        number: The command's number on its socket, which joins what was asked with what came of it.
        outcome: `asked`, then `accepted`, `failed` or `refused`; `done` for what no robot has to confirm.
        text: The answer, or what it is about.
    """

    time: str = ""
    who: str = ""
    role: str = ""
    address: str = ""
    act: str = ""
    robot: str = ""
    number: int = 0
    outcome: str
    text: str = ""


class AuditLog:
    """Takes entries from any thread and writes them in the order they came; `lost` is how many could not be kept."""

    def __init__(
        self,
        folder: Path,
        wall_ns: Callable[[], int],
        *,
        most_bytes: int = _MOST_BYTES,
        kept: int = _KEPT,
        write: Callable[[int, bytes], int] = os.write,
    ) -> None:
        """Write into a folder; at `most_bytes` the file is put aside, and `kept` older ones are kept."""
        self._path = folder / NAME
        self._wall_ns = wall_ns
        self._most_bytes = most_bytes
        self._kept = kept
        self._write_bytes = write
        self._waiting: queue.Queue[bytes | None] = queue.Queue(_MOST_WAITING)
        self._lock = threading.Lock()
        self.lost = 0
        self._has_logged = False
        self._file: int | None = None
        self._is_torn = False
        self._thread = threading.Thread(target=self._run, name="audit", daemon=True)
        self._thread.start()

    def add(self, entry: AuditEntry) -> None:
        """Keep an entry; never waits."""
        seconds, rest_ns = divmod(self._wall_ns(), 1_000_000_000)
        time = dt.datetime.fromtimestamp(seconds, dt.UTC).strftime("%Y-%m-%dT%H:%M:%S") + f".{rest_ns // 1000:06}Z"
        line = msgspec.json.encode(msgspec.structs.replace(entry, time=time, text=entry.text[:_LONGEST_TEXT]))
        try:
            self._waiting.put_nowait(line + b"\n")
        except queue.Full:
            self._lose("more happens than can be written")

    def close(self) -> None:
        """Write what waits, within a moment."""
        with contextlib.suppress(queue.Full):
            self._waiting.put(None, timeout=_ENDS_WITHIN_S)
        self._thread.join(_ENDS_WITHIN_S)

    def _run(self) -> None:
        while (line := self._waiting.get()) is not None:
            try:
                self._write(line)
            except OSError as error:
                self._close()
                self._lose(str(error.strerror or error))
        self._close()

    def _write(self, line: bytes) -> None:
        if self._file is None:
            flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
            self._file = os.open(self._path, flags, 0o600)
        file = self._file
        if os.fstat(file).st_size + len(line) > self._most_bytes:
            self._close()
            paths = [self._path, *(self._path.with_suffix(f".{number + 1}.jsonl") for number in range(self._kept))]
            for newer, older in reversed(list(itertools.pairwise(paths))):
                with contextlib.suppress(FileNotFoundError):
                    newer.replace(older)
            self._write(line)
            return
        # What was torn off by a full disk is ended first, so that each line is an entry or is not JSON at all.
        whole = b"\n" + line if self._is_torn else line
        written = self._write_bytes(file, whole)
        self._is_torn = written != len(whole)
        if self._is_torn:
            raise OSError(0, "the disk is full")
        self._has_logged = False

    def _close(self) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError):
                os.fsync(self._file)
            os.close(self._file)
            self._file = None

    def _lose(self, why: str) -> None:
        with self._lock:
            self.lost += 1
            has_logged, self._has_logged = self._has_logged, True
        if not has_logged:
            _logger.error("the audit log %s cannot be written: %s; the station goes on without it", self._path, why)
