# SPDX-License-Identifier: MIT
"""A recorder in front of another: what is written is passed on, but for what a kind of front changes."""

from collections.abc import Sequence

from segway_ecc.node.cycle.interfaces import CycleRecord, Recorder
from segway_ecc.node.cycle.status import DiagnosticStatus


class RecorderFront:
    """Passes everything on to the recorder behind; a front overrides what it observes or disturbs. See `Recorder`."""

    def __init__(self, behind: Recorder) -> None:
        """Stand in front of `behind`."""
        self._behind = behind

    def write(self, record: CycleRecord) -> None:
        """Record one cycle."""
        self._behind.write(record)

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Record a set of diagnostics."""
        self._behind.write_diagnostics(stamp_ns, statuses)

    def close(self) -> None:
        """Finish the log."""
        self._behind.close()
