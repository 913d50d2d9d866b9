# SPDX-License-Identifier: MIT
"""The console of a guest, on which the command's output is kept apart from the kernel's."""

import codecs
import os
import re
import selectors
import time
from collections import deque
from collections.abc import Callable
from typing import IO

# A kernel that panics writes why first, and then some fifty lines.
_LINES_IN_ERROR = 60
_PANIC = re.compile(r"\[ *\d+\.\d+\] Kernel panic - not syncing")
_PANIC_TAKES_S = 5.0


class Console:
    """Splits the guest's console by the marks that its first process writes around the command's output.

    Attributes:
        output: The output of the command, in pieces of at most a line.
    """

    def __init__(self, token: str, on_output: Callable[[str], None] | None) -> None:
        self.output: list[str] = []
        self._tail: deque[str] = deque(maxlen=_LINES_IN_ERROR)
        self._begin, self._end = f"{token} begin", f"{token} end"
        self._on_output = on_output
        self._in_command = False
        self._partial = ""
        self._panicked_s: float | None = None

    def follow(self, stream: IO[bytes] | None, deadline: float) -> bool:
        """Read the console until the guest has ended, True, or `time.monotonic()` passes the deadline, False.

        It has ended when it closes the console, and some seconds after its kernel panicked: stopping its other
        processors, such a kernel can come to wait for a lock that one of them held, and never end.
        """
        decoder = codecs.getincrementaldecoder("utf-8")("replace")
        closed = stream is None
        with selectors.DefaultSelector() as selector:
            if stream is not None:
                selector.register(stream, selectors.EVENT_READ)
            while not closed and (left := deadline - time.monotonic()) > 0:
                for key, _ in selector.select(left):
                    chunk = os.read(key.fd, 65536)
                    *lines, self._partial = (self._partial + decoder.decode(chunk)).split("\n")
                    for line in lines:
                        # The guest's terminal ends each line with a carriage return too.
                        self._add_line(line.removesuffix("\r") + "\n")
                    closed = not chunk
                if self._panicked_s is not None:
                    deadline = min(deadline, self._panicked_s + _PANIC_TAKES_S)
        if self._partial:
            self._add_line(self._partial)
        return closed or self._panicked_s is not None

    def last_lines(self) -> str:
        """Return the end of an error message: the last lines of the kernel and the command together."""
        return "; the console's last lines:" + "".join(f"\n  {line}" for line in self._tail)

    def _add_line(self, line: str) -> None:
        if self._begin in line:
            self._in_command = True
            return
        if self._panicked_s is None and _PANIC.search(line):
            self._panicked_s = time.monotonic()
        # The mark follows the end of the command's output on the same line where they did not end with a newline.
        text, mark, _ = line.partition(self._end)
        if text.strip():
            self._tail.append(text.rstrip())
        if self._in_command and text:
            self.output.append(text)
            if self._on_output is not None:
                self._on_output(text)
        self._in_command = self._in_command and not mark
