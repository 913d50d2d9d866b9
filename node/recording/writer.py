"""The process that writes a run's log; it reads frames from its standard input until that ends."""

import ctypes
import os
import select
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from node.errors import RecordingError
from node.recording.bounded_log import FLUSH_NS, BoundedLog
from node.recording.bounds import Bounds
from node.recording.codec import FRAME_HEADER
from node.recording.layout import Layout
from node.recording.provenance import Provenance

_PR_SET_PDEATHSIG: Final = 1
"""From linux/prctl.h."""
_READ_BYTES: Final = 1 << 20
_PAUSE_S: Final = 0.02


class Job(msgspec.Struct, frozen=True):
    """What the writer is told first, as one line of JSON.

    Attributes:
        path: The log to write.
        layout: Names of what each cycle holds.
        provenance: Where the run comes from.
        bounds: How much room it may take.
    """

    path: str
    layout: Layout
    provenance: Provenance
    bounds: Bounds


def write_log(source: int) -> None:
    """Write the log that the first line of `source`, a file descriptor, describes from the frames that follow.

    Raises:
        RecordingError: The log cannot be written, or its end is missing.
    """
    frames = _Frames(source)
    job = msgspec.json.decode(frames.line(), type=Job)
    log = BoundedLog(Path(job.path), job.layout, job.provenance, job.bounds, _tell)
    due_ns = time.monotonic_ns() + FLUSH_NS
    while not frames.is_over:
        # Nobody waits at the pipe: to wake who does would cost the loop more than all the rest of its part.
        time.sleep(_PAUSE_S)
        for kind, body in frames.read():
            log.write(kind, body)
        if time.monotonic_ns() >= due_ns:
            log.flush()
            due_ns = time.monotonic_ns() + FLUSH_NS
    log.close()


class _Frames:
    """Cuts what comes through a pipe into frames.

    Attributes:
        is_over: Whether the pipe has ended.
    """

    def __init__(self, source: int) -> None:
        self.is_over = False
        self._source = source
        self._held = bytearray()

    def line(self) -> bytes:
        """The first line; waits for it."""
        while (end := self._held.find(b"\n")) < 0 and not self.is_over:
            self._fill()
        line = bytes(self._held[: end + 1])
        del self._held[: end + 1]
        return line

    def read(self) -> Iterator[tuple[bytes, bytes]]:
        """What has come; nothing where nothing has."""
        if select.select([self._source], [], [], 0)[0]:
            self._fill()
        begin, held = 0, self._held
        while len(held) - begin >= FRAME_HEADER.size:
            kind, length = FRAME_HEADER.unpack_from(held, begin)
            end = begin + FRAME_HEADER.size + length
            if end > len(held):
                break
            yield kind, bytes(held[begin + FRAME_HEADER.size : end])
            begin = end
        del held[:begin]

    def _fill(self) -> None:
        data = os.read(self._source, _READ_BYTES)
        self.is_over = not data
        self._held += data


def _tell(text: str) -> None:
    sys.stderr.write(f"segway-ecc: recorder: {text}\n")


def _wake_when_the_node_is_gone() -> None:
    """Be continued (SIGCONT) when the node dies: a writer that is stopped just then would never see its pipe end."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGCONT))


def main() -> int:
    """Run as a process; the signals that end the loop leave it to finish the log."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    _wake_when_the_node_is_gone()
    try:
        write_log(sys.stdin.fileno())
    except RecordingError as error:
        _tell(str(error))
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
