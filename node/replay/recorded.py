# SPDX-License-Identifier: MIT
"""The hardware, the stage and the clock of a run, which answer as they did when it was recorded."""

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.errors import ArmingRefusedError, LinkLostError
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.interfaces import CycleRecord, HardwareAnswer, Inbox, NoStage
from segway_ecc.node.recording.layout import CycleLayout

_NO_LIMIT: Final = float("inf")


class RecordedHardware:
    """Measures and answers as recorded; see `Hardware`. What it is sent is compared elsewhere.

    Attributes:
        record: The cycle that is being replayed; None before the first.
    """

    health: Mapping[str, str] = {}

    def __init__(self, layout: CycleLayout) -> None:
        """Have the signals and commands of a layout; their units do not matter here."""
        self.signals: Mapping[str, str] = dict.fromkeys(layout.sensors, "")
        self.commands: Mapping[str, str] = dict.fromkeys(layout.commands, "")
        self.limits: Sequence[float] = tuple(_NO_LIMIT if limit is None else limit for limit in layout.limits)
        self.record: CycleRecord | None = None
        self._answers: deque[HardwareAnswer] = deque()
        self._exchanged: int | None = None

    def pass_to(self, record: CycleRecord) -> None:
        """Pass to a cycle."""
        self.record = record
        self._answers = deque(record.answers)

    def open(self) -> None:
        """Nothing to open."""

    def exchange(self, commands: Sequence[float] | None) -> Sensors:
        """What was measured.

        Raises:
            LinkLostError: The link was lost here.
        """
        del commands
        if self.record is None:
            return Sensors()
        if self._exchanged is None:  # before the first cycle
            self._exchanged = -1
            return self.record.initial or self.record.sensors
        is_first, self._exchanged = self._exchanged != self.record.cycle, self.record.cycle
        lost = self._next_reasons("exchange" if is_first else "send")
        if lost is not None:
            raise LinkLostError("; ".join(lost))
        return self.record.sensors

    def arm(self) -> None:
        """Arm, unless it was refused.

        Raises:
            ArmingRefusedError: It was.
        """
        reasons = self._next_reasons("arm")
        if reasons is not None:
            raise ArmingRefusedError(reasons)

    def arming_failures(self) -> Sequence[str]:
        """What kept it from arming."""
        return self._next_reasons("obstacles") or ()

    def disarm(self) -> None:
        """Nothing to disarm."""

    def close(self) -> None:
        """Nothing to close."""

    def _next_reasons(self, call: str) -> tuple[str, ...] | None:
        """What the hardware had against a call; None where the next answer is to another one."""
        return self._answers.popleft().reasons if self._answers and self._answers[0].call == call else None


class RecordedStage(NoStage):
    """Hands over what had arrived; see `Stage`."""

    def __init__(self, hardware: RecordedHardware) -> None:
        """Hand over what arrived in the hardware's cycle."""
        self._hardware = hardware

    def take_inbox(self) -> Inbox:
        """What arrived in this cycle."""
        record = self._hardware.record
        return record.inbox or Inbox() if record is not None else Inbox()


class RecordedClock:
    """Stands at the start of each cycle as recorded; see `Clock`. Nothing else that a cycle reads of it decides."""

    def __init__(self, hardware: RecordedHardware) -> None:
        """Stand where the hardware's cycle started."""
        self._hardware = hardware

    def now_ns(self) -> int:
        """When the cycle started."""
        return 0 if self._hardware.record is None else self._hardware.record.start_ns

    def wall_ns(self) -> int:
        """The stamp of the cycle."""
        return 0 if self._hardware.record is None else self._hardware.record.stamp_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Time passes with the record."""
