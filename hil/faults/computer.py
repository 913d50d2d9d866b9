# SPDX-License-Identifier: MIT
"""What the node runs on, as faults make it: its clock, on which it stalls or dies, and the disk of its recorder."""

from collections.abc import Callable, Sequence

from segway_ecc.hil.errors import RigError
from segway_ecc.hil.faults.fault import Injection, Injections, active
from segway_ecc.hil.rig.fronts import RecorderFront
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.cycle.interfaces import CycleRecord, Recorder
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.errors import RecordingError


class ProcessKilledError(RigError):
    """The node was killed, as the scenario declares."""


class DisturbedClock:
    """Hands the rig's time to the node; see `Clock`. Its monotonic time is never wrong: `now_ns` is the rig's own."""

    def __init__(self, rig: LockstepRig, injections: Injections) -> None:
        """Stand in front of a rig."""
        self.on_kill: Callable[[], None] | None = None
        self.now_ns = rig.now_ns
        self._rig = rig
        self._clock = injections.of("clock")
        self._process = injections.of("process")
        self._stalled: list[Injection] = []

    def wall_ns(self) -> int:
        """Simulated wall-clock time, and what is wrong with it."""
        wall_ns = self._rig.wall_ns()
        for injection in active(self._clock):
            since_ns, size = injection.since_ns, injection.size
            match injection.fault.type:
                case "stuck":
                    wall_ns -= since_ns
                case "slow":
                    wall_ns -= round(size * since_ns)
                case _:
                    wall_ns += round(size * 1e9)
        return wall_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Let the devices run up to the deadline, or further where the node stalls.

        Raises:
            ProcessKilledError: The node is dead.
        """
        self._rig.sleep_until_ns(deadline_ns)
        for injection in active(self._process):
            match injection.fault.type:
                case "off":
                    if self.on_kill is not None:
                        self.on_kill()
                    raise ProcessKilledError("the node was killed, as the scenario declares")
                case "slow":
                    self.spend(injection.size)
                case "stuck" if injection not in self._stalled:
                    self._stalled.append(injection)
                    self.spend(injection.size)

    def spend(self, duration_s: float) -> None:
        """Let time pass for everybody but the node, s."""
        self._rig.sleep_until_ns(self._rig.now_ns() + round(duration_s * 1e9))


class FailingRecorder(RecorderFront):
    """A recorder on a disk that fails as the scenario declares; see `Recorder`."""

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

    def write_state(self, take: Callable[[], Snapshot]) -> None:
        """Keep a snapshot, or lose it."""
        losses = [injection for injection in active(self._injections) if injection.fault.type == "intermittent"]
        if not any(injection.happens() for injection in losses):
            super().write_state(take)

    def _fail(self) -> None:
        for injection in active(self._injections):
            match injection.fault.type:
                case "slow":
                    self._clock.spend(injection.size)
                case "off":
                    raise RecordingError("the disk has failed, as the scenario declares")
