# SPDX-License-Identifier: MIT
"""What a model prints: read as fast as it comes, and logged with a limit; the rest is counted."""

import fcntl
import itertools
import os
import re
import select
import struct
import termios
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Final

AT_ONCE: Final = 20
"""So many lines are logged however fast they come, and then"""
PER_S: Final = 1.0
"""so many each second."""
COUNT_EVERY_S: Final = 10.0
"""The rest is reported as a number, at most so often."""
_LAST: Final = 5
"""So many lines before the end of a process that failed are logged in any case."""
_LONGEST: Final = 300
"""Characters of a line."""
_PARTIAL: Final = 4096
"""Bytes without an end that are taken for a line."""
_READ_BYTES: Final = 1 << 20
_PAUSE_S: Final = 1.0
_FATAL: Final = b"Fatal Python error: "
"""With this Python's faulthandler begins, the last that a process writes that a signal ends."""
_CURRENT: Final = b"Current thread ", b"Stack "
"""With either of these the calls of the thread begin in which it happened."""
_MOST_FATAL: Final = 200
_PLACE: Final = re.compile(rb'File "(?P<file>[^"]+)", line (?P<line>\d+)')
_OURS: Final = b"/node/native/library.py"
"""Where the innermost call is that of native code, of which no line is known."""


class ModelOutput:
    """Reads a pipe, in a thread of its own, and logs its lines.

    Attributes:
        name: The model, as it is called in messages.
    """

    def __init__(
        self, pipe: int, write: Callable[[str], object], now_s: Callable[[], float] = time.monotonic, *, name: str
    ) -> None:
        """Read the file descriptor `pipe`, and give lines of the model of this `name` to `write`."""
        self.name = name
        self._pipe = pipe
        self._write = write
        self._now_s = now_s
        self._size = fcntl.fcntl(pipe, fcntl.F_GETPIPE_SZ)
        self._wake, self._waking = os.pipe()
        self._is_ending = threading.Event()
        self._done = threading.Event()
        self._partial = b""
        self._fatal: list[bytes] | None = None
        self._tokens, self._filled_s = float(AT_ONCE), now_s()
        self._dropped, self._is_lossy, self._counted_s = 0, False, now_s()
        self._last: deque[bytes] = deque(maxlen=_LAST)
        os.set_blocking(pipe, False)

    def run(self) -> None:
        """Read until `finish` is called, and then what is left."""
        while not self._is_ending.is_set():
            select.select([self._pipe, self._wake], [], [], _PAUSE_S)
            if not self._read():  # nobody can print any more
                self._is_ending.wait()
            self._count(is_due=False)
        while self._read() and self._available():
            pass
        self._done.set()

    def finish(self, within_s: float) -> None:
        """Read what is left, and end."""
        self._is_ending.set()
        os.write(self._waking, b"\0")
        self._done.wait(within_s)

    def close(self, *, has_failed: bool) -> None:
        """Log what was held back: a part of a line, the last lines of a process that failed, and how many were not."""
        if self._partial:
            self.take(b"\n")
        if has_failed:
            self._dropped = max(self._dropped - len(self._last), 0)
            for line in self._last:
                self._show(line)
        elif self._fatal is not None:
            fatal, self._fatal = self._fatal, None
            self._log(fatal)
        self._count(is_due=True)

    def take(self, printed: bytes) -> None:
        """Take a piece of what is printed."""
        printed, self._partial = self._partial + printed, b""
        if self._fatal is None and _FATAL in printed:
            before, _, after = printed.partition(_FATAL)
            self._log(before.splitlines())
            self._fatal, printed = [], _FATAL + after
        *lines, self._partial = printed.split(b"\n")
        if len(self._partial) > _PARTIAL:
            lines, self._partial = [*lines, self._partial], b""
        if self._fatal is None:
            self._log(lines)
        elif len(self._fatal) + len(lines) <= _MOST_FATAL:
            self._fatal += lines
        else:  # that was no faulthandler
            lines, self._fatal = [*self._fatal, *lines], None
            self._log(lines)

    def _log(self, lines: list[bytes]) -> None:
        now_s = self._now_s()
        self._tokens = min(self._tokens + (now_s - self._filled_s) * PER_S, float(AT_ONCE))
        self._filled_s = now_s
        shown = min(len(lines), int(self._tokens))
        self._tokens -= shown
        for line in lines[:shown]:
            self._last.clear()
            self._show(line)
        self._dropped += len(lines) - shown
        self._last.extend(lines[shown:][-_LAST:])

    def _show(self, line: bytes) -> None:
        self._write(f"segway-ecc: model '{self.name}' printed: {_readable(line)}\n")

    def _count(self, *, is_due: bool) -> None:
        now_s = self._now_s()
        if not self._dropped or not (is_due or now_s - self._counted_s >= COUNT_EVERY_S):
            return
        lost = ", and more that was lost" if self._is_lossy else ""
        self._write(f"segway-ecc: model '{self.name}' printed {self._dropped} more lines{lost}\n")
        self._dropped, self._is_lossy, self._counted_s = 0, False, now_s

    def _available(self) -> int:
        (count,) = struct.unpack("i", fcntl.ioctl(self._pipe, termios.FIONREAD, b"\0" * 4))
        return int(count)

    def _read(self) -> bool:
        """Take what is there; False where nobody can print any more."""
        self._is_lossy |= self._available() > self._size - select.PIPE_BUF
        try:
            printed = os.read(self._pipe, _READ_BYTES)
        except BlockingIOError:
            return True
        if printed:
            self.take(printed)
        return bool(printed)

    @property
    def reason(self) -> str:
        """Why the process that printed has ended, and where; empty where that is not known."""
        return _readable(self._fatal[0].removeprefix(_FATAL)).lower() + self.place if self._fatal else ""

    @property
    def place(self) -> str:
        """The line of Python in which it has ended, in brackets; empty where it is not known, as in native code."""
        lines = itertools.dropwhile(lambda line: not line.startswith(_CURRENT), self._fatal or ())
        found = next(filter(None, map(_PLACE.search, lines)), None)
        if found is None or found["file"].endswith(_OURS):
            return ""
        return f" ({_readable(found['file'])}:{int(found['line'])})"


def _readable(line: bytes) -> str:
    text = line.decode(errors="replace").rstrip()
    shown = "".join(letter if letter.isprintable() else "?" for letter in text[:_LONGEST])
    return f"{shown} ..." if len(text) > _LONGEST else shown
