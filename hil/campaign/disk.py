# SPDX-License-Identifier: MIT
"""A recorder on a disk that fails as the scenario declares."""

from collections.abc import Sequence

from segway_ecc.hil.faults.clock import DisturbedClock
from segway_ecc.hil.faults.injection import Injections
from segway_ecc.hil.rig.recorder_front import RecorderFront
from segway_ecc.node.cycle.interfaces import CycleRecord, Recorder
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.errors import RecordingError


class FailingRecorder(RecorderFront):
    """Stands in front of a recorder; see `Recorder`."""

    def __init__(self, recorder: Recorder, injections: Injections, clock: DisturbedClock) -> None:
        """Stand in front of `recorder`."""
        super().__init__(recorder)
        self._injections = injections.of("disk")
        self._clock = clock

    def write(self, record: CycleRecord) -> None:
        """Keep one cycle, or fail to.

        Raises:
            RecordingError: The disk has failed.
        """
        self._fail()
        super().write(record)

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Keep diagnostics, or fail to.

        Raises:
            RecordingError: The disk has failed.
        """
        self._fail()
        super().write_diagnostics(stamp_ns, statuses)

    def _fail(self) -> None:
        for injection in self._injections:
            if not injection.is_active:
                continue
            if injection.fault.type == "slow":
                self._clock.spend(injection.fault.size or 0.0)
            else:
                raise RecordingError("the disk has failed, as the scenario declares")
