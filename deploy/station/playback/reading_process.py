# SPDX-License-Identifier: MIT
"""The process that reads logs for the station: `python -P -m segway_ecc.deploy.station.playback.reading_process FD`.

A process of its own, since a log that is cut short while it is read ends whoever has it mapped (SIGBUS), and since what
unpacks hours of a log would keep the station from its heartbeats.
"""

import contextlib
import os
import signal
import socket
import struct
import sys
from collections import OrderedDict
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.deploy.station.playback.recorded_log import RecordedLog
from segway_ecc.node.errors import NodeError, exception_text, shortened
from segway_ecc.node.recording.salvage import Salvage

_NICENESS: Final = 10
_MOST_OPEN: Final = 3
_READ_BYTES: Final = 65_536
HEAD: Final = struct.Struct("<?I")
"""Of an answer: whether it is one, else why there is none follows, and how many bytes follow."""


class ReadRequest(msgspec.Struct, frozen=True, kw_only=True):
    """What is asked of a log, whose open file comes with it.

    Attributes:
        name: Of the file, for messages.
        rows: From when to when, s, and in how many rows at most; None for the log as a whole.
    """

    name: str
    rows: tuple[float, float, int] | None = None


class _Open:
    def __init__(self, log: RecordedLog, size: int, changed_ns: int) -> None:
        self.log = log
        self.size = size
        self.changed_ns = changed_ns


class OpenLogs:
    """The logs that were asked for last, looked through already."""

    def __init__(self) -> None:
        """Have none."""
        self._logs: OrderedDict[tuple[int, int], _Open] = OrderedDict()

    def answer(self, request: ReadRequest, file: int) -> bytes:
        """What is asked for, as JSON.

        Raises:
            RecordingError: It is no log of a run.
        """
        log = self._log(request.name, file, is_newest=request.rows is None)
        return msgspec.json.encode(log.view() if request.rows is None else log.rows(*request.rows))

    def _log(self, name: str, file: int, *, is_newest: bool) -> RecordedLog:
        """The log in a file; one that has grown is looked through again where the newest is asked for."""
        status = os.fstat(file)
        key = status.st_dev, status.st_ino
        known = self._logs.pop(key, None)
        is_as_it_was = known is not None and (known.size, known.changed_ns) == (status.st_size, status.st_mtime_ns)
        if known is None or status.st_size < known.size or (is_newest and not is_as_it_was):
            known = _Open(RecordedLog(Salvage(Path(name), file)), status.st_size, status.st_mtime_ns)
        self._logs[key] = known
        while len(self._logs) > _MOST_OPEN:
            self._logs.popitem(last=False)
        return known.log


def serve(channel: socket.socket) -> None:
    """Answer until the other end is closed."""
    logs = OpenLogs()
    received = b""
    while True:
        message, files, _, _ = socket.recv_fds(channel, _READ_BYTES, 1)
        if not message:
            return
        received += message
        if not received.endswith(b"\n"):  # a descriptor comes with the last of it
            continue
        try:
            is_answer, content = True, logs.answer(msgspec.json.decode(received, type=ReadRequest), files[0])
        except NodeError as error:
            is_answer, content = False, str(error).encode()
        except Exception as error:  # noqa: BLE001 - a log may be anybody's
            is_answer, content = False, shortened(f"it cannot be read: {exception_text(error)}").encode()
        for file in files:
            os.close(file)
        received = b""
        channel.sendall(HEAD.pack(is_answer, len(content)) + content)


def main() -> int:
    """Serve the socket of this number; signals to the station end us through it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    with contextlib.suppress(OSError):
        os.nice(_NICENESS)
    with contextlib.suppress(ConnectionError), socket.socket(fileno=int(sys.argv[1])) as channel:
        serve(channel)
    return 0


if __name__ == "__main__":
    sys.exit(main())
