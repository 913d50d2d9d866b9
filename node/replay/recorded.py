# SPDX-License-Identifier: MIT
"""A run as it was recorded: read as far as its log goes, and what answers in it as the robot's parts did then."""

import contextlib
import math
import struct
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import msgspec
from msgspec.structs import replace

from segway_ecc.firmware_io.errors import ArmingRefusedError, LinkLostError
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.config import RobotFile, convert_robot
from segway_ecc.node.cycle.interfaces import (
    UNSEEN_CALL,
    CycleRecord,
    HardwareAnswer,
    Inbox,
    NoStage,
    VariableWrite,
    Written,
)
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.errors import ConfigurationError, RecordingError, shortened
from segway_ecc.node.recording import cdr
from segway_ecc.node.recording.codec import unpack_state
from segway_ecc.node.recording.cycle_log import EVENTS_TOPIC, LAYOUT_FILE, STATE_TOPIC
from segway_ecc.node.recording.cycle_message import CYCLE_TOPIC, CycleMessage, restore_events
from segway_ecc.node.recording.layout import END_FILE, MODEL, PART_FILE, ROBOT_FILE, CycleLayout, LogEnd, LogPart
from segway_ecc.node.recording.log_quota import following_parts, part_paths
from segway_ecc.node.recording.salvage import Salvage

_T = TypeVar("_T")


class RecordedRun:
    """A log, read from its beginning; a run in several files is read through all of them.

    Attributes:
        path: Of the log, or of the first of its files.
        robot: The robot file that was in force.
        layout: Names of what each cycle holds.
        model_hash: Of the model that ran; empty where the log lacks it.
        version: Of the segway-ecc that recorded it; empty where the log lacks it.
        snapshot: What was recorded of the state before the cycle that was read last; None where nothing was.
        is_joined: Whether no cycle is missing before that one.
        is_complete: Whether all that happened in that one is there.
        gap: What is missing first, and where; None as long as nothing is.
        missing: The cycles that are missing, each time the first and the last of them.
        damage: What is damaged in the files that were read.
        is_cut: Whether a file ends before its time, as after a power cut, or the run has no end in them.
    """

    def __init__(self, path: Path) -> None:
        """Read the beginning.

        Raises:
            RecordingError: It is no log of a run, or one that cannot be replayed.
        """
        self.path = path
        self.snapshot: Snapshot | None = None
        self.is_joined = self.is_complete = True
        self.gap: str | None = None
        self.missing: list[tuple[int, int]] = []
        self._first = Salvage(path)
        self.damage = list(self._first.damage)
        self.is_cut = self._first.is_cut
        self.robot = _robot_of(self._first)
        self.layout = _decoded(self._first, LAYOUT_FILE, CycleLayout)
        self.model_hash = self._first.metadata.get(MODEL, {}).get("sha256", "")
        self.version = self._first.metadata.get("software", {}).get("segway-ecc", "")
        self._message = CycleMessage(self.layout)
        self._newest: Snapshot | None = None
        self._last_cycle: int | None = None

    def cycles(self) -> Iterator[CycleRecord]:
        """Every cycle that is there, in order; see `snapshot` and what follows it."""
        expected, unseen = 0, 0
        for file in self._files():
            unseen += file.counts.get(CYCLE_TOPIC, 0)
            for record, found, events in self._records(file):
                unseen -= 1
                if record.cycle < expected:
                    self._report(f"{file.path.name}: there are cycles that come twice or out of order")
                    continue
                self.is_joined, lacks = record.cycle == expected, _lacks(record, found, events)
                if not self.is_joined:
                    self._lack(expected, record.cycle)
                    unseen -= record.cycle - expected
                self.gap, self.is_complete = self.gap or lacks, lacks is None
                newest, self._newest = self._newest, None
                self.snapshot = newest if newest is not None and newest.cycle == record.cycle else None
                expected = record.cycle + 1
                yield record
        end = max(expected + unseen, expected if self._last_cycle is None else self._last_cycle + 1)
        if end > expected:
            self._lack(expected, end, is_end=True)

    def _files(self) -> Iterator[Salvage]:
        """The files of the run, in order; what is missing or does not belong there is damage."""
        first, is_ended = _part_of(self._first, 1), False
        expected = first.number
        later = part_paths(self.path)[1:] if expected == 1 else following_parts(self.path)
        for path in (self.path, *later):
            file = self._first if path == self.path else Salvage(path)
            part = _part_of(file, expected)
            if part.run != first.run and is_ended:
                continue  # a log of its own
            if part.run != first.run:
                self._report(f"{path.name}: it is of another run")
                continue
            if part.number != expected:
                self._report(f"{path.name}: it is part {part.number} of the run, where part {expected} should be")
            if part.number < expected:
                continue
            expected = part.number + 1
            is_ended = END_FILE in file.attachments
            if is_ended:
                self._read_end(file, part)
            self.is_cut = self.is_cut or file.is_cut
            self._report(*file.damage)
            yield file
            self._report(*file.damage)  # what the messages showed
        self.is_cut = self.is_cut or not is_ended

    def _read_end(self, file: Salvage, part: LogPart) -> None:
        """Learn which cycle was the run's last."""
        end = _decoded(file, END_FILE, LogEnd)
        self._last_cycle = end.last_cycle
        if end.number != part.number:
            self._report(f"{file.path.name}: its end is that of part {end.number}, and it is part {part.number}")

    def _report(self, *damage: str) -> None:
        self.damage += [text for text in damage if text not in self.damage]

    def _records(self, file: Salvage) -> Iterator[tuple[CycleRecord, int, int]]:
        """The cycles of a file, each with how many texts about it there are and were."""
        texts: dict[int, list[str]] = {}
        for topic, message in file.messages():
            if topic == EVENTS_TOPIC:
                cycle, found = cdr.read_cycle_events(message.data)
                texts.setdefault(cycle, []).extend(found)
            elif topic == STATE_TOPIC:
                try:
                    self._newest = unpack_state(cdr.read_state(message.data))
                except msgspec.DecodeError as error:
                    self._report(f"{file.path.name}: a message on {STATE_TOPIC} is damaged: {error}")
            elif topic == CYCLE_TOPIC:
                try:
                    record, events = self._message.unpack(message.data)
                except (struct.error, IndexError) as error:
                    where = f"the log {self.path}"
                    raise RecordingError(f"{where} does not hold the cycles of its layout: {error}") from error
                held = texts.get(record.cycle, ())
                texts.clear()
                yield restore_events(record, held), len(held), events

    def _lack(self, first: int, end: int, *, is_end: bool = False) -> None:
        self.missing.append((first, end - 1))
        missing = f"cycles {first} to {end - 1} are missing in the log"
        self.gap = self.gap or (f"the log begins with cycle {end}" if first == 0 and not is_end else missing)


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
        unseen = tuple(name for answer in record.answers if answer.call == UNSEEN_CALL for name in answer.reasons)
        self.record = record if not unseen else replace(record, sensors=replace(record.sensors, unseen=unseen))
        self._answers = deque(answer for answer in record.answers if answer.call != UNSEEN_CALL)

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
        # Their events are with the cycle that they were recorded with.
        return self.record.sensors if is_first else replace(self.record.sensors, events=())

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
        """What arrived in this cycle; what was written in it is to be written again."""
        inbox = (self.record.inbox if self.record is not None else None) or Inbox()
        if self.record is None or self.record.cycle == 0 or not inbox.written:
            return inbox  # what is recorded in the first cycle was written before the initial equations
        writes = [VariableWrite(values, lambda _refusal: None) for values, _ in writes_in(inbox.written)]
        return replace(inbox, writes=writes, written=[])

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


def writes_in(written: Sequence[Written]) -> Iterator[tuple[list[tuple[str, float]], str]]:
    """What was written together, in order, each with why it was refused, or empty."""
    values: list[tuple[str, float]] = []
    for name, value, refusal, has_more in written:
        values.append((name, value))
        if not has_more:
            yield values, refusal
            values = []


def _decoded(file: Salvage, name: str, kind: type[_T]) -> _T:
    with _explained(file, name):
        return msgspec.json.decode(file.attachments[name], type=kind)


def _robot_of(file: Salvage) -> RobotFile:
    with _explained(file, ROBOT_FILE):
        return convert_robot(msgspec.json.decode(file.attachments[ROBOT_FILE]), "the robot file in it")


@contextlib.contextmanager
def _explained(file: Salvage, name: str) -> Iterator[None]:
    """Where an attachment is not there, or is not as this version writes it, that is why a log is not replayed."""
    if name not in file.attachments:
        raise RecordingError(f"{file.path} cannot be replayed: it is no log of a run (there is no {name} in it)")
    try:
        yield
    except (msgspec.MsgspecError, ConfigurationError, UnicodeError, RecursionError) as error:
        problem = shortened(str(error))
        raise RecordingError(
            f"{file.path} cannot be replayed: its {name} is of another version of segway-ecc: {problem}"
        ) from error


def _part_of(file: Salvage, number: int) -> LogPart:
    """Which file of which run it is; of one from before that was written, the file that it is named as."""
    return _decoded(file, PART_FILE, LogPart) if PART_FILE in file.attachments else LogPart("", number)


def _lacks(record: CycleRecord, found: int, events: int) -> str | None:
    """What is missing of a cycle."""
    if record.cycle == 0 and not events:
        return "the log lacks the snapshot that the model started from"
    if found == events:
        return None
    return f"of what happened in cycle {record.cycle} only {found} of {events} are in the log"
