"""The process that writes a run's log; it reads cycles from its standard input until that ends."""

import signal
import sys
from pathlib import Path
from typing import BinaryIO

import msgspec

from node.errors import RecordingError
from node.recording.codec import CYCLE, FRAME_HEADER, CycleCodec, unpack_diagnostics
from node.recording.cycle_log import CycleLog
from node.recording.recorder import Job


def write_log(stream: BinaryIO) -> None:
    """Write the log that the first line of `stream` describes from the frames that follow.

    Raises:
        RecordingError: The log cannot be written.
    """
    job = msgspec.json.decode(stream.readline(), type=Job)
    codec = CycleCodec(job.layout)
    log = CycleLog(Path(job.path), job.layout)
    try:
        for name, text in job.attachments.items():
            log.attach(name, "text/plain", text.encode())
        while (frame := _read_frame(stream)) is not None:
            kind, body = frame
            if kind == CYCLE:
                log.write(codec.unpack(body))
            else:
                diagnostics = unpack_diagnostics(body)
                log.write_diagnostics(diagnostics.stamp_ns, diagnostics.statuses)
    finally:
        log.close()


def _read_frame(stream: BinaryIO) -> tuple[bytes, bytes] | None:
    header = stream.read(FRAME_HEADER.size)
    if len(header) < FRAME_HEADER.size:
        return None
    kind, length = FRAME_HEADER.unpack(header)
    body = stream.read(length)
    return (kind, body) if len(body) == length else None


def main() -> int:
    """Run as a process; the signals that end the loop leave it to finish the log."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        write_log(sys.stdin.buffer)
    except RecordingError as error:
        sys.stderr.write(f"segway-ecc: recorder: {error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
