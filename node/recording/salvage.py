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
from collections.abc import Collection, Iterable, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Final, NamedTuple

from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]  # what mcap itself unpacks with
from mcap.data_stream import RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    Schema,
    Statistics,
)
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.cycle_log import COPIES
from segway_ecc.node.recording.mcap_log import CHANNEL, COUNTS, MISSING, REPAIR, McapLog

# What the library raises at bytes that are not what they should be; LZ4 raises RuntimeError.
_DAMAGE = (
    McapError, EOFError, struct.error, ValueError, RuntimeError, KeyError, IndexError, AttributeError, MemoryError
)  # fmt: skip
_HEAD: Final = struct.Struct("<BQ")
_CHANNEL_ID: Final = struct.Struct("<H")
_MESSAGE_HEAD: Final = 22
"""Of a message: its topic's number, its own, and two times, bytes."""
_ANY_HEAD: Final = re.compile(rb"[\x01-\x0f].{4}\x00{4}", re.DOTALL)
"""An opcode and a length below 4 GiB."""
_SHAPES: Final[Mapping[int, tuple[int, ...]]] = {
    Opcode.HEADER: (-4, -4), Opcode.FOOTER: (20,), Opcode.SCHEMA: (2, -4, -4, -4), Opcode.CHANNEL: (4, -4, -4, -4),
    Opcode.CHUNK: (28, -4, -8), Opcode.MESSAGE_INDEX: (2, -4), Opcode.CHUNK_INDEX: (32, -4, 8, -4, 16),
    Opcode.ATTACHMENT: (16, -4, -4, -8, 4), Opcode.ATTACHMENT_INDEX: (40, -4, -4), Opcode.STATISTICS: (42, -4),
    Opcode.METADATA: (-4, -4), Opcode.METADATA_INDEX: (16, -4), Opcode.SUMMARY_OFFSET: (17,), Opcode.DATA_END: (4,),
}  # fmt: skip
"""What a record outside of chunks consists of: so many bytes, or a length of 4 or 8 bytes and as many bytes."""
_REPORTED: Final = 100
"""Places at most that are named, so that the work for each is bounded."""
_LOOKED_AT: Final = 4
"""Times the file's size that may be read of what looks like records and is none: a damaged chunk is looked at once."""
_LZ4: Final = "lz4"
_LARGEST_CHUNK: Final = 256 << 20
"""Unpacked, in bytes; ours have 256 KiB, and a message that is larger has one of its own."""
_BEGINNING: Final = MCAP0_MAGIC + bytes([Opcode.HEADER])
_SHORTEST: Final = 2 * len(MCAP0_MAGIC)
_FOOTER_UNDER_CRC: Final = _HEAD.size + 16


class SalvagedTopic(NamedTuple):
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

    def __init__(self, path: Path, descriptor: int | None = None) -> None:
        """Find all that is whole; in the open file of `descriptor`, which stays the caller's, where one is given.

        Raises:
            RecordingError: The file cannot be read.
        """
        self.path = path
        self.damage: list[str] = []
        self.attachments: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.counts: dict[str, int] = {}
        self.topics: dict[str, SalvagedTopic] = {}
        self._names: dict[int, str] = {}
        self._schemas: dict[int, Schema] = {}
        self._wanted: dict[str, int] = {}
        self._chunks: list[tuple[int, int]] = []
        if descriptor is None and path.exists() and not path.is_file():  # a pipe would be waited for
            raise RecordingError(f"cannot read the log {path}: it is no file")
        try:
            with path.open("rb") if descriptor is None else open(descriptor, "rb", closefd=False) as stream:
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
        found = dict.fromkeys(self._wanted, 0)
        for topic, message in self._messages_in(self._chunks):
            found[topic] = found.get(topic, 0) + 1
            yield topic, message
        self._compare_counts(found)

    def newest(self, topic: str) -> Message | None:
        """The last message on a topic that is whole; reads no more of the file than it has to."""
        for place in reversed(self._chunks):
            found = [message for name, message in self._messages_in([place]) if name == topic]
            if found:
                return found[-1]
        return None

    @property
    def chunk_count(self) -> int:
        """How many chunks are whole."""
        return len(self._chunks)

    def payloads(self, chunk: int, topics: Collection[str]) -> Iterator[tuple[str, bytes]]:
        """The messages on some topics in a chunk, as bytes; of all others nothing is made, which takes long.

        Raises:
            RecordingError: The chunk has changed since it was found whole.
        """
        try:
            with memoryview(self._unpacked(chunk)) as data:
                yield from self._payloads_in(data, topics)
        except _DAMAGE as error:
            raise RecordingError(f"the log {self.path} has changed while it was read: {error}") from error

    def _unpacked(self, chunk: int) -> bytes:
        begin, end = self._chunks[chunk]
        found = next(StreamReader(BytesIO(self._data[begin:end]), skip_magic=True, emit_chunks=True).records)
        if not isinstance(found, Chunk):
            raise RecordingError(f"the log {self.path} has changed while it was read")
        stream, size = get_chunk_data_stream(found, validate_crc=True)
        return stream.read(size)

    def _payloads_in(self, data: memoryview, topics: Collection[str]) -> Iterator[tuple[str, bytes]]:
        at = 0
        while at < len(data):
            opcode, size = _HEAD.unpack_from(data, at)
            begin, at = at, at + _HEAD.size + size
            if opcode == Opcode.MESSAGE:
                topic = self._names.get(_CHANNEL_ID.unpack_from(data, begin + _HEAD.size)[0])
                if topic is not None and topic in topics:
                    yield topic, bytes(data[begin + _HEAD.size + _MESSAGE_HEAD : at])
            else:  # a topic or its type
                self._keep(next(StreamReader(BytesIO(data[begin:at]), skip_magic=True).records))

    def _messages_in(self, chunks: Iterable[tuple[int, int]]) -> Iterator[tuple[str, Message]]:
        for begin, end in chunks:
            chunk = _record_in(self._data, begin, end)
            for record in breakup_chunk(chunk) if isinstance(chunk, Chunk) else ():
                if isinstance(record, Message) and record.channel_id in self._names:
                    yield self._names[record.channel_id], record
                elif isinstance(record, Message):
                    self._report(f"a message's topic is not known: its number is {record.channel_id}")
                else:
                    self._keep(record)

    def _compare_counts(self, found: Mapping[str, int]) -> None:
        """Report what a topic lacks of the messages that it had when the log was closed."""
        lacks = [
            f"{wanted - found.get(topic, 0)} of {wanted} messages on {topic}"
            for topic, wanted in self._wanted.items()
            if wanted > found.get(topic, 0)
        ]
        if lacks:
            self._report(f"{', '.join(lacks)} are missing")

    def _look_through(self) -> None:
        """Find the records; what is between two of them is damaged."""
        begin = self._find_beginning()
        end, footer = begin + len(MCAP0_MAGIC), None
        data_end, statistics = (begin, 0), None
        for offset, next_offset, record in _whole_records(self._data, end):
            self._note_gap(end, offset)
            end = next_offset
            match record:
                case Chunk():
                    self._chunks.append((offset, next_offset))
                case DataEnd():
                    data_end = offset, record.data_section_crc
                case Statistics():
                    statistics = record
                case Footer():
                    footer = offset, record
                case Header() if (
                    offset > begin + len(MCAP0_MAGIC) and self._data[offset - len(MCAP0_MAGIC) : offset] == MCAP0_MAGIC
                ):
                    self._report(f"another log begins at byte {offset}, and is not read")
                    return
                case _:
                    self._keep(record)
        if footer is None:
            self._note_gap(end, len(self._data))
        else:
            self._check(begin, data_end, statistics, *footer)

    def _find_beginning(self) -> int:
        """Where the log begins: at its first bytes, or behind some that belong to none."""
        if self._data[: len(MCAP0_MAGIC)] == MCAP0_MAGIC:
            return 0
        begin = self._data.find(_BEGINNING)
        if begin <= 0 or _end_at(self._data, len(MCAP0_MAGIC)) is not None:  # else it would be another log behind this
            self._report("its first 8 bytes are not those of an MCAP file")
            return 0
        self._report(f"its first {begin} bytes are not of the log")
        return begin

    def _check(
        self, begin: int, data_end: tuple[int, int], statistics: Statistics | None, offset: int, footer: Footer
    ) -> None:
        """Check the sums of a file that has an end: of the data up to `data_end`, and of the summary."""
        self.is_cut = footer.summary_start == 0  # as a file ends while it is written; see McapLog
        if self._data[-len(MCAP0_MAGIC) :] != MCAP0_MAGIC:
            self._report("its last 8 bytes are not those of an MCAP file")
        length, crc = data_end
        if not self.damage and not _has_crc(self._data, begin, length, crc):
            self._report("the checksum over its data does not hold, though each of its chunks is whole")
        summary = begin + footer.summary_start if footer.summary_start else offset
        if not _has_crc(self._data, summary, offset + _FOOTER_UNDER_CRC, footer.summary_crc):
            self._report("its summary is damaged")
        elif statistics is not None:
            counts = statistics.channel_message_counts
            self.counts = {name: counts.get(number, 0) for number, name in self._names.items()}
            self._compare_counts(self.counts)

    def _keep(self, record: McapRecord) -> None:
        match record:
            case Attachment(name=name, data=data):
                self.attachments[name] = data
            case Metadata(name=name, metadata=values) if name.startswith(CHANNEL):
                with contextlib.suppress(ValueError, KeyError):  # it has no checksum of its own
                    self.topics[values["topic"]] = SalvagedTopic(values["type"], values["definition"])
                    self._names[int(name.removeprefix(CHANNEL))] = values["topic"]
            case Metadata(name=name, metadata=values) if name == COUNTS:
                with contextlib.suppress(ValueError):  # as above
                    self._wanted = {topic: int(count) for topic, count in values.items()}
            case Metadata(name=name, metadata=values):
                self.metadata[name] = values
            case Schema():
                self._schemas[record.id] = record
            case Channel() if record.schema_id in self._schemas:
                schema = self._schemas[record.schema_id]
                self.topics[record.topic] = SalvagedTopic(schema.name, schema.data.decode(errors="replace"))
                self._names[record.id] = record.topic
            case _:
                pass

    def _note_gap(self, begin: int, end: int) -> None:
        """Report the bytes from `begin` to `end`, unless they are a record that the end of the file cuts off."""
        size, is_last = end - begin, self.is_cut and end == len(self._data)
        is_cut_off = size < _HEAD.size or _HEAD.size + _HEAD.unpack_from(self._data, begin)[1] > size
        if size > 0 and not (is_last and is_cut_off):
            self._report(f"bytes {begin} to {end - 1} are damaged")

    def _report(self, text: str) -> None:
        text = f"{self.path.name}: {text if len(self.damage) < _REPORTED else 'more is damaged'}"
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
    try:
        with McapLog(out) as log:
            return _copy(source, log)
    except BaseException:
        out.unlink(missing_ok=True)  # half a log would be taken for all that is left
        raise


def _copy(source: Salvage, log: McapLog) -> int:
    count = 0
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


def _whole_records(data: bytes | mmap.mmap, offset: int) -> Iterator[tuple[int, int, McapRecord]]:
    """Every record from there on that is whole, and where it begins and ends; the work is linear in the size."""
    left = _LOOKED_AT * len(data)
    while left >= 0:
        end = _end_at(data, offset)
        record = None if end is None else _record_in(data, offset, end)
        if end is None or record is None:
            left -= 0 if end is None else end - offset
            head = _ANY_HEAD.search(data, offset + 1)
            if head is None:
                return
            offset = head.start()
            continue
        yield offset, end, record
        offset = end


def _end_at(data: bytes | mmap.mmap, offset: int) -> int | None:
    """The end of what has the shape of a record and begins there; None where nothing does."""
    if len(data) < offset + _HEAD.size:
        return None
    end = offset + _HEAD.size + _HEAD.unpack_from(data, offset)[1]
    return end if end <= len(data) and _has_shape(data, offset, end) else None


def _record_in(data: bytes | mmap.mmap, offset: int, end: int) -> McapRecord | None:
    """The record that is there by its shape; None where it is damaged."""
    found, builder = data[offset:end], RecordBuilder()
    try:
        record = next(StreamReader(BytesIO(found), skip_magic=True, emit_chunks=True).records)
        record.write(builder)  # an attachment with the checksum that it should have
        again = builder.end()  # type: ignore[no-untyped-call]  # mcap annotates arguments, and this has none
        is_whole = again == found and not isinstance(record, Message)  # which is in a chunk
        if isinstance(record, Chunk):
            is_whole = is_whole and _unpacks(record)
    except _DAMAGE:
        return None
    if isinstance(record, Footer):
        is_whole = is_whole and end + len(MCAP0_MAGIC) >= len(data)
    return record if is_whole else None


def _unpacks(chunk: Chunk) -> bool:
    """Whether a chunk's data have the size and the checksum that it gives; of more than that nothing is unpacked."""
    if chunk.uncompressed_size > _LARGEST_CHUNK:
        return False
    if chunk.compression != _LZ4:
        return get_chunk_data_stream(chunk, validate_crc=True)[1] == chunk.uncompressed_size
    unpacker = LZ4FrameDecompressor()
    found: bytes = unpacker.decompress(chunk.data, max_length=chunk.uncompressed_size + 1)
    is_whole = unpacker.eof and len(found) == chunk.uncompressed_size
    return is_whole and chunk.uncompressed_crc in {0, zlib.crc32(found)}


def _has_shape(data: bytes | mmap.mmap, offset: int, end: int) -> bool:
    """Whether the parts of a record fill it, so that nothing large is copied of what only looks like one."""
    shape, at = _SHAPES.get(data[offset]), offset + _HEAD.size
    for part in shape or ():
        at += part if part > 0 else int.from_bytes(data[at : at - part], "little") - part
    return shape is not None and at == end


def _has_crc(data: bytes | mmap.mmap, begin: int, end: int, crc: int) -> bool:
    """Whether a checksum holds; zero means that there is none. Nothing is copied for it."""
    with memoryview(data) as whole, whole[begin:end] as part:
        return crc == 0 or zlib.crc32(part) == crc
