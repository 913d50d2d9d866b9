"""The console of a user-mode Linux guest: tells what the command said from what the kernel said."""

import codecs
import os
import selectors
import time
from collections import deque
from collections.abc import Callable
from typing import IO

_LINES_IN_ERROR = 25


class Console:
    """Splits the guest's console by the marks that its first process writes around the command's output.

    Attributes:
        output: What the command said, in pieces of at most a line.
    """

    def __init__(self, token: str, on_output: Callable[[str], None] | None) -> None:
        self.output: list[str] = []
        self._tail: deque[str] = deque(maxlen=_LINES_IN_ERROR)
        self._begin, self._end = f"{token} begin", f"{token} end"
        self._on_output = on_output
        self._in_command = False
        self._partial = ""

    def follow(self, stream: IO[bytes] | None, deadline: float) -> bool:
        """Read the console until the guest closes it, True, or `time.monotonic()` passes the deadline, False."""
        decoder = codecs.getincrementaldecoder("utf-8")("replace")
        closed = stream is None
        with selectors.DefaultSelector() as selector:
            if stream is not None:
                selector.register(stream, selectors.EVENT_READ)
            while not closed and (left := deadline - time.monotonic()) > 0:
                for key, _ in selector.select(left):
                    chunk = os.read(key.fd, 65536)
                    self._feed(decoder.decode(chunk))
                    closed = not chunk
        if self._partial:
            self._take(self._partial)
        return closed

    def last_lines(self) -> str:
        """Return the end of an error message: the last lines of the kernel and the command together."""
        return "; the console's last lines:" + "".join(f"\n  {line}" for line in self._tail)

    def _feed(self, text: str) -> None:
        *lines, self._partial = (self._partial + text).split("\n")
        for line in lines:
            # The guest's terminal ends each line with a carriage return too.
            self._take(line.removesuffix("\r") + "\n")

    def _take(self, line: str) -> None:
        if self._begin in line:
            self._in_command = True
            return
        # The mark follows the command's last words on the same line where they did not end with a newline.
        said, mark, _ = line.partition(self._end)
        if said.strip():
            self._tail.append(said.rstrip())
        if self._in_command and said:
            self.output.append(said)
            if self._on_output is not None:
                self._on_output(said)
        self._in_command = self._in_command and not mark
