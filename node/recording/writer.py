# SPDX-License-Identifier: MIT
"""The process that writes a run's log: its settings come through its standard input, the cycles through a ring."""

import ctypes
import itertools
import os
import select
import signal
import sys
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.bounded_log import BoundedLog
from segway_ecc.node.recording.codec import CycleCodec, RecorderSettings
from segway_ecc.node.recording.provenance import with_surroundings
from segway_ecc.node.ring import RingReader

_PR_SET_PDEATHSIG: Final = 1
"""From linux/prctl.h."""
_PAUSE_S: Final = 0.5
"""Between two looks, after each of which all goes to the disk: a power cut loses this much, and what one flush takes.

What was handed over is safe from anything else, and many at once cost less than each alone.
"""
_SHORT_PAUSE_S: Final = 0.01
_MANY: Final = 512
"""So many at one look, and the next comes sooner: memory is no larger for it."""
_LOOKS: Final = 2
"""At the end: a ring looks twice at what does not look whole."""


def write_log(source: int, memory: int) -> None:
    """Write the log that the first line of `source` describes from the messages in a ring.

    Args:
        source: A file descriptor, which ends when the loop has; nothing comes through it but that line.
        memory: That of the ring.

    Raises:
        RecordingError: The log cannot be written, or its end is missing.
    """
    with os.fdopen(source, "rb", closefd=False) as stream:
        settings = msgspec.json.decode(stream.readline(), type=RecorderSettings)
    codec = CycleCodec(settings.layout)
    ring = RingReader(memory)
    provenance = with_surroundings(settings.provenance)
    log = BoundedLog(Path(settings.path), settings.layout, provenance, settings.bounds, _report)
    damaged, pause_s = 0, _SHORT_PAUSE_S
    # Nobody waits at the ring: to wake who does would cost the loop more than all the rest of its part.
    while not (select.select([source], [], [], pause_s)[0] and not os.read(source, 1)):
        taken, lost = _keep_all(log, codec, ring)
        damaged += lost
        pause_s = _SHORT_PAUSE_S if taken == _MANY else _PAUSE_S
        log.flush()
    looks_for_nothing = 0
    while looks_for_nothing < _LOOKS:
        taken, lost = _keep_all(log, codec, ring)
        damaged += lost
        looks_for_nothing += taken == 0
    damaged += ring.damaged
    if damaged:
        _report(f"{damaged} records were damaged on their way and are missing in the log {settings.path}")
    log.close()


def _keep_all(log: BoundedLog, codec: CycleCodec, ring: RingReader) -> tuple[int, int]:
    """Log messages that have arrived, `_MANY` at most; returns how many they were, and how many of them damaged."""
    taken = damaged = 0
    for message in itertools.islice(ring.take_messages(), _MANY):
        taken += 1
        try:
            bodies = codec.bodies(*message)
        except RecordingError:
            damaged += 1
            continue
        for kind, body in bodies:
            log.write(kind, body)
    return taken, damaged


def _report(text: str) -> None:
    sys.stderr.write(f"segway-ecc: recorder: {text}\n")


def main() -> int:
    """Run as a process; the signals that end the loop leave it to finish the log."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    signal.signal(signal.SIGABRT, signal.SIG_IGN)  # how a service manager's watchdog ends all of a service
    # Continued when the node dies: a writer that is stopped just then would never see its input end.
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGCONT))
    try:
        write_log(sys.stdin.fileno(), int(sys.argv[1]))
    except RecordingError as error:
        _report(str(error))
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
