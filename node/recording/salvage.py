# SPDX-License-Identifier: MIT
"""What a log still holds: every record that is whole, also behind damage, and what is not whole; and its repair.

A flipped byte costs the chunk that it is in. A chunk and an attachment have a checksum of their own; whatever else
stands in a finished file is under the checksum of the data section or of the summary (https://mcap.dev/spec). A log
that is repaired has summary and index again, for every tool that reads MCAP.
"""

import contextlib
import mmap
import re
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Final, NamedTuple

from mcap.data_stream import RecordBuilder
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, McapRecord, Message, Metadata, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.cycle_log import COPIES
from segway_ecc.node.recording.mcap_log import CHANNEL, MISSING, REPAIR, McapLog

# What the library raises at bytes that are not what they should be; LZ4 raises RuntimeError.
_DAMAGE = (McapError, EOFError, struct.error, ValueError, RuntimeError, KeyError, IndexError, AttributeError)
_HEAD: Final = struct.Struct("<BQ")
_ANY_HEAD: Final = re.compile(rb"[\x01-\x0f].{4}\x00{4}", re.DOTALL)
"""An opcode and a length below 4 GiB."""
_SHORTEST: Final = 2 * len(MCAP0_MAGIC)
_FOOTER_UNDER_CRC: Final = _HEAD.size + 16


class Topic(NamedTuple):
    """The type of a topic's messages, and that type's definition."""

    type_name: str
    definition: str


class Salvage:
    """What one file holds; also one that a power cut has cut off, that is being written, or that is damaged anywhere.

    Attributes:
        damage: What is damaged in it, a text for each place.
        is_cut: Whether it has no proper end, as after a power cut or while it is written.
        topics: Those known so far, by name.
        counts: How many messages each topic had, where the summary is whole; else empty.
    """

    def __init__(self, path: Path) -> None:
        """Find all that is whole.

        Raises:
            RecordingError: The file cannot be read.
        """
        self.path = path
        self.damage: list[str] = []
        self.attachments: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.counts: dict[str, int] = {}
        self.topics: dict[str, Topic] = {}
        self._names: dict[int, str] = {}
        self._schemas: dict[int, Schema] = {}
        self._chunks: list[int] = []
        try:
            with path.open("rb") as stream:
                is_empty = stream.seek(0, 2) == 0
                self._data = b"" if is_empty else mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise RecordingError(f"cannot read the log {path}: {error.strerror}") from error
        self.is_cut = len(self._data) < _SHORTEST or self._data[-len(MCAP0_MAGIC) :] != MCAP0_MAGIC
        self._look_through()
        repaired = self.metadata.get(REPAIR, {})
        self.damage += [text for name, text in repaired.items() if name.startswith("damage")]
        if MISSING in self.metadata:
            self._report(f"{self.metadata[MISSING].get('messages')} messages never reached it")
        self.is_cut = self.is_cut or repaired.get("is_cut") == "true"

    @property
    def is_whole(self) -> bool:
        """Whether nothing is missing or damaged in it."""
        return not self.damage and not self.is_cut

    def messages(self) -> Iterator[tuple[str, Message]]:
        """The messages of every chunk that is whole, each with its topic."""
        for offset in self._chunks:
            found = _record_at(self._data, offset)
            for record in breakup_chunk(found[1]) if found is not None and isinstance(found[1], Chunk) else ():
                if isinstance(record, Message) and record.channel_id in self._names:
                    yield self._names[record.channel_id], record
                elif isinstance(record, Message):
                    self._report(f"a message's topic is not known: its number is {record.channel_id}")
                else:
                    self._keep(record)

    def _look_through(self) -> None:
        """Find the records; what is between two of them is damaged."""
        end, footer = len(MCAP0_MAGIC), None
        data_end, statistics = (0, 0), None
        if self._data[:end] != MCAP0_MAGIC:
            self._report("its first 8 bytes are not those of an MCAP file")
        for offset, next_offset, record in _whole_records(self._data):
            self._note_gap(end, offset)
            end = next_offset
            match record:
                case Chunk():
                    self._chunks.append(offset)
                case DataEnd():
                    data_end = offset, record.data_section_crc
                case Statistics():
                    statistics = record
                case Footer():
                    footer = offset, record
                case _:
                    self._keep(record)
        if footer is None:
            self._note_gap(end, len(self._data))
        else:
            self._check(data_end, statistics, *footer)

    def _check(self, data_end: tuple[int, int], statistics: Statistics | None, offset: int, footer: Footer) -> None:
        """Check the sums of a file that has an end: of the data up to `data_end`, and of the summary."""
        self.is_cut = footer.summary_start == 0  # as a file ends while it is written; see McapLog
        if self._data[-len(MCAP0_MAGIC) :] != MCAP0_MAGIC:
            self._report("its last 8 bytes are not those of an MCAP file")
        length, crc = data_end
        if not self.damage and not _has_crc(self._data[:length], crc):
            self._report("the checksum over its data does not hold, though each of its chunks is whole")
        if not _has_crc(self._data[footer.summary_start or offset : offset + _FOOTER_UNDER_CRC], footer.summary_crc):
            self._report("its summary is damaged")
        elif statistics is not None:
            counts = statistics.channel_message_counts
            self.counts = {name: counts.get(number, 0) for number, name in self._names.items()}

    def _keep(self, record: McapRecord) -> None:
        match record:
            case Attachment(name=name, data=data):
                self.attachments[name] = data
            case Metadata(name=name, metadata=values) if name.startswith(CHANNEL):
                with contextlib.suppress(ValueError, KeyError):  # it has no checksum of its own
                    self.topics[values["topic"]] = Topic(values["type"], values["definition"])
                    self._names[int(name.removeprefix(CHANNEL))] = values["topic"]
            case Metadata(name=name, metadata=values):
                self.metadata[name] = values
            case Schema():
                self._schemas[record.id] = record
            case Channel() if record.schema_id in self._schemas:
                schema = self._schemas[record.schema_id]
                self.topics[record.topic] = Topic(schema.name, schema.data.decode(errors="replace"))
                self._names[record.id] = record.topic
            case _:
                pass

    def _note_gap(self, begin: int, end: int) -> None:
        """Report the bytes from `begin` to `end`, unless they are a record that the end of the file cuts off."""
        rest = self._data[begin:end]
        is_last = self.is_cut and end == len(self._data)
        is_cut_off = len(rest) < _HEAD.size or _HEAD.size + _HEAD.unpack_from(rest)[1] > len(rest)
        if rest and not (is_last and is_cut_off):
            self._report(f"bytes {begin} to {end - 1} are damaged")

    def _report(self, text: str) -> None:
        text = f"{self.path.name}: {text}"
        if text not in self.damage:
            self.damage.append(text)


def repair_log(source: Salvage, out: Path) -> int:
    """Write all that is whole in a log to another file, with what is not as metadata; returns how many messages.

    Raises:
        RecordingError: Nothing is left of it, or `out` is there already or cannot be written.
    """
    if not source.topics:
        raise RecordingError(f"{source.path} cannot be repaired: there is no message in it")
    if out.exists():
        raise RecordingError(f"{out} is there already; choose another with --out")
    count = 0
    with McapLog(out) as log:
        for name, values in source.metadata.items():
            log.metadata(name, values)
        for name, data in source.attachments.items():
            log.attach(name, "text/plain", data, COPIES)
        for topic, message in source.messages():
            type_name, definition = source.topics[topic]
            log.add(topic, type_name, message.log_time, message.data, definition)
            count += 1
        lacks = {f"damage {number}": text for number, text in enumerate(source.damage)}
        log.metadata(REPAIR, {"is_cut": str(source.is_cut).lower(), **lacks})
    return count


def _whole_records(data: bytes | mmap.mmap) -> Iterator[tuple[int, int, McapRecord]]:
    """Every record that is whole, and where it begins and ends."""
    offset = len(MCAP0_MAGIC)
    while True:
        found = _record_at(data, offset)
        if found is None:
            head = _ANY_HEAD.search(data, offset + 1)
            if head is None:
                return
            offset = head.start()
            continue
        yield offset, *found
        offset = found[0]


def _record_at(data: bytes | mmap.mmap, offset: int) -> tuple[int, McapRecord] | None:
    """The end of the record that begins there, and the record; None where none does, or it is damaged."""
    if len(data) < offset + _HEAD.size:
        return None
    end = offset + _HEAD.size + _HEAD.unpack_from(data, offset)[1]
    if end > len(data):
        return None
    found, builder = data[offset:end], RecordBuilder()
    try:
        record = next(StreamReader(BytesIO(found), skip_magic=True, emit_chunks=True).records)
        record.write(builder)  # an attachment with the checksum that it should have
        again = builder.end()  # type: ignore[no-untyped-call]  # mcap annotates arguments, and this has none
        is_whole = again == found and not isinstance(record, Message)  # which is in a chunk
        if isinstance(record, Chunk):
            is_whole = is_whole and get_chunk_data_stream(record, validate_crc=True)[1] == record.uncompressed_size
    except _DAMAGE:
        return None
    if isinstance(record, Footer):
        is_whole = is_whole and end + len(MCAP0_MAGIC) >= len(data)
    return (end, record) if is_whole else None


def _has_crc(data: bytes, crc: int) -> bool:
    """Whether a checksum holds; zero means that there is none."""
    return crc in {0, zlib.crc32(data)}
