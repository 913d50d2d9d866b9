# SPDX-License-Identifier: MIT
"""A run as it was recorded: read as far as its log goes, and what answers in it as the robot's parts did then."""

import math
import struct
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import msgspec
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Footer, Message, Metadata
from mcap.stream_reader import StreamReader

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

_T = TypeVar("_T")
# What the library raises at bytes that are not what they should be; LZ4 raises RuntimeError.
_DAMAGE = (McapError, EOFError, struct.error, ValueError, RuntimeError, KeyError, IndexError, AttributeError)


class Salvage:
    """What one file holds, read from its beginning; also one that a power cut or a full disk has cut off anywhere.

    Attributes:
        is_whole: Whether the file was read to its proper end.
        attachments: Those met so far, by name.
        metadata: Those met so far, by name.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.is_whole = False
        self.attachments: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}

    def messages(self) -> Iterator[tuple[str, Message]]:
        """The messages, each with its topic, up to where the file is cut off or damaged.

        Raises:
            RecordingError: The file cannot be opened.
        """
        try:
            stream = self.path.open("rb")
        except OSError as error:
            raise RecordingError(f"cannot read the log {self.path}: {error.strerror}") from error
        channels: dict[int, str] = {}
        with stream:
            records = iter(StreamReader(stream, validate_crcs=True).records)
            while True:
                try:
                    record = next(records, None)
                except _DAMAGE:
                    return
                match record:
                    case None:
                        return
                    case Attachment(name=name, data=data):
                        self.attachments[name] = data
                    case Metadata(name=name, metadata=values):
                        self.metadata[name] = values
                    case Channel(id=number, topic=topic):
                        channels[number] = topic
                    case Message() if record.channel_id in channels:
                        yield channels[record.channel_id], record
                    case Footer():
                        self.is_whole = True


class RecordedRun:
    """A log, read from its beginning; a run in several files is read through all of them.

    Attributes:
        path: Of the log, or of the first of its files.
        robot: The robot file that was in force.
        layout: Names of what each cycle holds.
        model_hash: Of the model that ran; empty where the log lacks it.
        gap: What is missing, and where; None as long as nothing is.
        is_cut: Whether the last file that was read ends before its time, as after a power cut.
    """

    def __init__(self, path: Path) -> None:
        """Read the beginning.

        Raises:
            RecordingError: It is no log of a run, or one that cannot be replayed.
        """
        self.path = path
        self.gap: str | None = None
        self.is_cut = False
        first = Salvage(path)
        next(first.messages(), None)
        self.robot = _decoded(first, ROBOT_FILE, RobotFile)
        self.layout = _decoded(first, LAYOUT_FILE, CycleLayout)
        self.model_hash = first.metadata.get(MODEL, {}).get("sha256", "")
        self._message = CycleMessage(self.layout)

    def cycles(self) -> Iterator[CycleRecord]:
        """The cycles, from the first one on, up to where one is missing; see `gap`."""
        texts: list[str] = []
        expected = 0
        for path in part_paths(self.path):
            file = Salvage(path)
            for topic, message in file.messages():
                if topic == EVENTS_TOPIC:
                    texts += cdr.read_cycle_events(message.data)[1]
                elif topic == CYCLE_TOPIC:
                    try:
                        record, events = self._message.unpack(message.data)
                    except (struct.error, IndexError) as error:
                        where = f"the log {self.path}"
                        raise RecordingError(f"{where} does not hold the cycles of its layout: {error}") from error
                    self.gap = _gap(record, expected, events, len(texts))
                    if self.gap is not None:
                        return
                    yield restore_events(record, texts)
                    texts = []
                    expected += 1
            self.is_cut = not file.is_whole


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


def _gap(record: CycleRecord, expected: int, events: int, found: int) -> str | None:
    """What is missing before or in a cycle."""
    if record.cycle != expected:
        if expected == 0:
            return f"the log begins with cycle {record.cycle}, and a replay needs the run from its beginning"
        return f"cycles {expected} to {record.cycle - 1} are missing in the log"
    if expected == 0 and not events:
        return "the log lacks the snapshot that the model started from"
    return None if events == found else f"of what happened in cycle {expected} only {found} of {events} are in the log"
