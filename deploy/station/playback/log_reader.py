# SPDX-License-Identifier: MIT
"""The station's side of the process that reads logs: asks it, and starts it again where it ended."""

import asyncio
import os
import socket
import subprocess
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import msgspec

from segway_ecc.deploy.station.playback.reading_process import HEAD, ReadRequest
from segway_ecc.node.errors import NodeError
from segway_ecc.node.helper import end_helper, start_helper

_MODULE: Final = "segway_ecc.deploy.station.playback.reading_process"
_MOST_WAITING: Final = 32
_LONGEST_S: Final = 120.0
"""For one answer: a log of 256 MB, the largest that a recorder begins, takes some 12 s."""
_ENDS_WITHIN_S: Final = 2.0


class LogReadingError(NodeError):
    """A log cannot be read.

    Attributes:
        is_busy: Whether it may be asked again: others are waiting, or it was changed meanwhile.
    """

    exit_code = 9

    def __init__(self, text: str, *, is_busy: bool = False) -> None:
        """Say why."""
        super().__init__(text)
        self.is_busy = is_busy


class LogReader:
    """Reads one log after the other, in the order of the requests; the process begins with the first of them."""

    def __init__(self) -> None:
        """Start nothing yet."""
        self._pool = ThreadPoolExecutor(1, "log-reader")
        self._waiting = 0
        self._process: tuple[subprocess.Popen[bytes], socket.socket] | None = None
        self._lock = threading.Lock()

    async def read(self, file: int, request: ReadRequest) -> bytes:
        """What is asked of the log in an open file, which is closed, as JSON.

        Raises:
            LogReadingError: It cannot be read, or too much is asked at once.
        """
        if self._waiting >= _MOST_WAITING:
            os.close(file)
            raise LogReadingError("too many logs are being read; wait a moment", is_busy=True)
        self._waiting += 1
        task = asyncio.get_running_loop().run_in_executor(self._pool, self._read, file, request)
        task.add_done_callback(self._on_done)
        return await asyncio.shield(task)  # it is carried out, and its file closed, also where nobody waits any more

    def close(self) -> None:
        """End the process; what is still asked fails."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._end()

    def _on_done(self, task: "asyncio.Future[bytes]") -> None:
        self._waiting -= 1
        if not task.cancelled():
            task.exception()  # it is not logged where nobody waits any more

    def _read(self, file: int, request: ReadRequest) -> bytes:
        try:
            return self._ask(file, request)
        except OSError as error:
            self._end()
            raise LogReadingError(f"reading {request.name} failed, try again: {error}", is_busy=True) from None
        finally:
            os.close(file)

    def _ask(self, file: int, request: ReadRequest) -> bytes:
        channel = self._channel()
        socket.send_fds(channel, [msgspec.json.encode(request) + b"\n"], [file])
        is_answer, size = HEAD.unpack(_received(channel, HEAD.size))
        content = _received(channel, size)
        if not is_answer:
            raise LogReadingError(content.decode(errors="replace"))
        return content

    def _channel(self) -> socket.socket:
        with self._lock:
            if self._process is None:
                ours, theirs = socket.socketpair()
                with theirs:
                    number = theirs.fileno()
                    self._process = start_helper(_MODULE, (str(number),), (number,)), ours
                ours.settimeout(_LONGEST_S)
            return self._process[1]

    def _end(self) -> None:
        with self._lock:
            if self._process is not None:
                process, channel = self._process
                self._process = None
                channel.close()
                process.kill()  # it keeps nothing
                end_helper(process, _ENDS_WITHIN_S)


def _received(channel: socket.socket, size: int) -> bytes:
    """So many bytes.

    Raises:
        ConnectionError: The other end is gone.
    """
    content = bytearray()
    while len(content) < size:
        piece = channel.recv(size - len(content))
        if not piece:
            raise ConnectionResetError("the process that reads it ended, as where a log is cut short meanwhile")
        content += piece
    return bytes(content)
