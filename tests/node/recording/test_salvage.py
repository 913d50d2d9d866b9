# SPDX-License-Identifier: MIT
"""What looking through a large log takes: memory for its largest chunk, wherever it is damaged."""

import io
import struct
import tracemalloc
import zlib
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]  # what mcap itself packs with
import pytest
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, Footer, Header, McapRecord, Metadata
from mcap.writer import MCAP0_MAGIC

from segway_ecc.node.recording.salvage import Salvage

MB = 1 << 20
SIZE = 24 * MB
NOTE = Metadata("note", {"a": "b"})


def encoded(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]  # mcap annotates arguments, and this has none


def looked_through(path: Path) -> tuple[Salvage, int]:
    """What a log holds, and how many bytes of memory were in use at most to find that."""
    tracemalloc.start()
    try:
        return Salvage(path), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("opcode", [each for each in Opcode if each is not Opcode.MESSAGE])
def test_what_looks_like_a_record_of_gigabytes_is_not_copied(tmp_path: Path, opcode: Opcode) -> None:
    path = tmp_path / "damaged.mcap"
    with path.open("wb") as file:
        file.write(MCAP0_MAGIC + encoded(Header("ros2", "test")))
        for offset in range(MB, SIZE, MB):
            file.seek(offset)
            file.write(struct.pack("<BQ", opcode, SIZE - offset - 9))
        file.seek(SIZE)
        file.write(encoded(NOTE))
    salvage, peak = looked_through(path)

    assert salvage.metadata == {"note": {"a": "b"}}
    assert len(salvage.damage) == 1
    assert peak < MB


@pytest.mark.parametrize("error", [0, 1])
def test_the_checksum_over_all_data_takes_no_more_memory_than_a_chunk(tmp_path: Path, error: int) -> None:
    path, content = tmp_path / "whole.mcap", bytes(MB)
    chunk = encoded(Chunk("", content, 0, 1, zlib.crc32(content), MB))
    with path.open("wb") as file:
        crc = 0
        for part in (MCAP0_MAGIC, encoded(Header("ros2", "test")), *([chunk] * (SIZE // MB))):
            file.write(part)
            crc = zlib.crc32(part, crc)
        file.write(encoded(DataEnd(crc + error)) + encoded(Footer(0, 0, 0)) + MCAP0_MAGIC)
    salvage, peak = looked_through(path)

    assert len(salvage.damage) == error
    assert peak < 10 * MB


def test_the_work_for_what_only_looks_like_records_is_linear_in_the_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Heads of chunks, each of which fills the rest of the file by its lengths."""
    path, size, checked = tmp_path / "crafted.mcap", MB // 2, 0
    content = bytearray(size)
    for offset in range(size - 100, 8, -60):  # opcode, length; times, size, checksum, compression; data
        struct.pack_into("<BQQQQIIQ", content, offset, 6, size - offset - 9, 0, 0, 1, 0, 0, size - offset - 49)
    path.write_bytes(MCAP0_MAGIC + content[8:])

    def count(data: bytes) -> object:
        nonlocal checked
        checked += len(data)
        return io.BytesIO(data)

    monkeypatch.setattr("segway_ecc.node.recording.salvage.BytesIO", count)
    found = Salvage(path)

    assert found.damage == [f"crafted.mcap: bytes 8 to {size - 1} are damaged"]
    assert 4 * size < checked <= 5 * size


def test_places_that_are_damaged_are_named_up_to_a_bound(tmp_path: Path) -> None:
    path = tmp_path / "damaged.mcap"
    path.write_bytes(MCAP0_MAGIC + encoded(Header("ros2", "test")) + (b"\xff" * 20 + encoded(NOTE)) * 500)
    damage = Salvage(path).damage

    assert len(damage) == 101
    assert damage[-1] == "damaged.mcap: more is damaged"


@pytest.mark.parametrize("given", [MB, 300 * MB])
def test_chunk_that_unpacks_to_more_than_is_allowed_or_said_is_damage(tmp_path: Path, given: int) -> None:
    path, content = tmp_path / "bomb.mcap", lz4.frame.compress(bytes(64 * MB))
    with path.open("wb") as file:
        file.write(MCAP0_MAGIC + encoded(Header("ros2", "test")))
        file.write(encoded(Chunk("lz4", content, 0, 1, 0, given)) + encoded(NOTE))
    salvage, peak = looked_through(path)

    assert salvage.metadata == {"note": {"a": "b"}}
    assert len(salvage.damage) == 1
    assert peak < 16 * MB
