# SPDX-License-Identifier: MIT
"""A run as it was recorded: the robot and its cycles, read as far as the log goes."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

import msgspec
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Footer, Message, Metadata
from mcap.stream_reader import StreamReader

from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.interfaces import CycleRecord
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
