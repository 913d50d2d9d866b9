# SPDX-License-Identifier: MIT
"""A run as it was recorded: read as far as its log goes, and what answers in it as the robot's parts did then."""

import math
import struct
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import msgspec

from segway_ecc.firmware_io.errors import ArmingRefusedError, LinkLostError
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.interfaces import CycleRecord, HardwareAnswer, Inbox, NoStage
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording import cdr
from segway_ecc.node.recording.cycle_log import EVENTS_TOPIC, LAYOUT_FILE
from segway_ecc.node.recording.cycle_message import CYCLE_TOPIC, CycleMessage, restore_events
from segway_ecc.node.recording.layout import MODEL, ROBOT_FILE, CycleLayout
from segway_ecc.node.recording.log_quota import part_paths
from segway_ecc.node.recording.salvage import Salvage

_T = TypeVar("_T")


class RecordedRun:
    """A log, read from its beginning; a run in several files is read through all of them.

    Attributes:
        path: Of the log, or of the first of its files.
        robot: The robot file that was in force.
        layout: Names of what each cycle holds.
        model_hash: Of the model that ran; empty where the log lacks it.
        gap: What is missing first, and where; None as long as nothing is.
        behind: How many cycles there are behind the gap.
        missing: The cycles that are missing, each time the first and the last of them.
        damage: What is damaged in the files that were read.
        is_cut: Whether the last file that was read ends before its time, as after a power cut.
    """

    def __init__(self, path: Path) -> None:
        """Read the beginning.

        Raises:
            RecordingError: It is no log of a run, or one that cannot be replayed.
        """
        self.path = path
        self.gap: str | None = None
        self.behind = 0
        self.missing: list[tuple[int, int]] = []
        self._first = Salvage(path)
        self.damage = list(self._first.damage)
        self.is_cut = self._first.is_cut
        self.robot = _decoded(self._first, ROBOT_FILE, RobotFile)
        self.layout = _decoded(self._first, LAYOUT_FILE, CycleLayout)
        self.model_hash = self._first.metadata.get(MODEL, {}).get("sha256", "")
        self._message = CycleMessage(self.layout)

    def cycles_before_gap(self) -> Iterator[CycleRecord]:
        """The cycles up to the first that is missing; those behind it are counted in `behind`."""
        for record in self.cycles():
            if self.gap is None:
                yield record
            else:
                self.behind += 1

    def cycles(self) -> Iterator[CycleRecord]:
        """Every cycle that is there, in order; behind the first that is missing, `gap` reports what it was."""
        expected, unseen = 0, 0
        for path in part_paths(self.path):
            file = self._first if path == self.path else Salvage(path)
            self.damage += [text for text in file.damage if text not in self.damage]
            unseen += file.counts.get(CYCLE_TOPIC, 0)
            for record, found, events in self._records(file):
                if record.cycle > expected:
                    self._lack(expected, record.cycle)
                    unseen -= record.cycle - expected
                self.gap = self.gap or _lacks(record, found, events)
                yield record
                expected = record.cycle + 1
                unseen -= 1
            self.is_cut = file.is_cut
        if unseen > 0:
            self._lack(expected, expected + unseen)

    def _records(self, file: Salvage) -> Iterator[tuple[CycleRecord, int, int]]:
        """The cycles of a file, each with how many texts about it there are and were."""
        texts: dict[int, list[str]] = {}
        for topic, message in file.messages():
            if topic == EVENTS_TOPIC:
                cycle, found = cdr.read_cycle_events(message.data)
                texts.setdefault(cycle, []).extend(found)
            elif topic == CYCLE_TOPIC:
                try:
                    record, events = self._message.unpack(message.data)
                except (struct.error, IndexError) as error:
                    where = f"the log {self.path}"
                    raise RecordingError(f"{where} does not hold the cycles of its layout: {error}") from error
                held = texts.get(record.cycle, ())
                texts.clear()
                yield restore_events(record, held), len(held), events

    def _lack(self, first: int, end: int) -> None:
        self.missing.append((first, end - 1))
        if first == 0:
            self.gap = self.gap or f"the log begins with cycle {end}, and a replay needs the run from its beginning"
        self.gap = self.gap or f"cycles {first} to {end - 1} are missing in the log"


class RecordedRobot(NoStage):
    """Hardware, stage and clock of a run in one, which answer as recorded; what is sent is compared elsewhere.

    Attributes:
        record: The cycle that is being replayed; None before the first.
    """

    health: Mapping[str, str] = {}

    def __init__(self, layout: CycleLayout) -> None:
        """Have the signals and commands of a layout; their units do not matter here."""
        self.signals: Mapping[str, str] = dict.fromkeys(layout.sensors, "")
        self.commands: Mapping[str, str] = dict.fromkeys(layout.commands, "")
        self.limits: Sequence[float] = tuple(math.inf if limit is None else limit for limit in layout.limits)
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

    def take_inbox(self) -> Inbox:
        """What arrived in this cycle."""
        return (self.record.inbox if self.record is not None else None) or Inbox()

    def now_ns(self) -> int:
        """When the cycle started. Nothing else that a cycle reads of a clock decides."""
        return 0 if self.record is None else self.record.start_ns

    def wall_ns(self) -> int:
        """The stamp of the cycle."""
        return 0 if self.record is None else self.record.stamp_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Time passes with the record."""

    def _next_reasons(self, call: str) -> tuple[str, ...] | None:
        """What the hardware had against a call; None where the next answer is to another one."""
        return self._answers.popleft().reasons if self._answers and self._answers[0].call == call else None


def _decoded(file: Salvage, name: str, kind: type[_T]) -> _T:
    if name not in file.attachments:
        raise RecordingError(f"{file.path} cannot be replayed: it is no log of a run (there is no {name} in it)")
    try:
        return msgspec.json.decode(file.attachments[name], type=kind)
    except msgspec.MsgspecError as error:
        raise RecordingError(
            f"{file.path} cannot be replayed: its {name} is of another version of segway-ecc: {error}"
        ) from error


def _lacks(record: CycleRecord, found: int, events: int) -> str | None:
    """What is missing of a cycle."""
    if record.cycle == 0 and not events:
        return "the log lacks the snapshot that the model started from"
    if found == events:
        return None
    return f"of what happened in cycle {record.cycle} only {found} of {events} are in the log"
