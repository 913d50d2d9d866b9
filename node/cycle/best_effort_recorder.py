# SPDX-License-Identifier: MIT
"""Best-effort recording: a recorder that fails never ends control."""

from collections import deque
from collections.abc import Sequence

from segway_ecc.node.cycle.interfaces import CycleRecord, NoRecorder, Recorder
from segway_ecc.node.cycle.status import DiagnosticStatus


class BestEffortRecorder:
    """Stands in front of a recorder and never raises: recording is worth less than control; see `Recorder`.

    Once the recorder has failed nothing more is given to it, and that is logged once; it is closed all the same.
    """

    def __init__(self, recorder: Recorder, events: deque[str]) -> None:
        """Stand in front of `recorder`; what happens to it is appended to `events`."""
        self._opened = recorder
        self._recorder = recorder
        self._events = events

    def write(self, record: CycleRecord) -> None:
        """Keep one cycle, while that can be done."""
        try:
            self._recorder.write(record)
        except Exception as error:  # noqa: BLE001 - whatever it is, the robot must not fall for it
            self._do_without(error)

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Keep a set of diagnostics, while that can be done."""
        try:
            self._recorder.write_diagnostics(stamp_ns, statuses)
        except Exception as error:  # noqa: BLE001 - as above
            self._do_without(error)

    def close(self) -> None:
        """Finish the log, as far as that can be done."""
        try:
            self._opened.close()
        except Exception as error:  # noqa: BLE001 - as above
            self._do_without(error)

    def _do_without(self, error: Exception) -> None:
        if not isinstance(self._recorder, NoRecorder):
            self._events.append(f"recording has ended: {type(error).__name__}: {error}")
        self._recorder = NoRecorder()
