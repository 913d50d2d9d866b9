# SPDX-License-Identifier: MIT
"""A log that was cut off anywhere is readable up to what was last put onto the disk."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader
from msgspec.structs import replace
from rosbags.highlevel import AnyReader

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import CycleLayout, Provenance
from segway_ecc.node.recording.salvage import Salvage

FLUSHED_EVERY = 3
CYCLES = 9
SMALL_EVERY = 2
CHUNK = 0x06
END = 50
"""Of a file that is being written, bytes: the end of its data, a footer and the magic."""


def written(
    path: Path, layout: CycleLayout, records: Sequence[CycleRecord], flushed_every: int = FLUSHED_EVERY
) -> tuple[Path, list[int]]:
    """A whole log, and how long the file was after each flush."""
    sizes = []
    made = CycleLog(path, layout, Provenance({"robot.json": "{}"}, {}))
    for count, record in enumerate(records, start=1):
        made.write(record)
        if count % flushed_every == 0:
            made.flush()
            assert path.stat().st_size == made.size + END  # until the next is written
            sizes.append(made.size)
    made.close()
    return path, sizes


@pytest.fixture
def log(tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]) -> tuple[Path, list[int]]:
    """A whole log, and how long the file was after each flush."""
    return written(tmp_path / "run.mcap", layout, [record(cycle) for cycle in range(CYCLES)])


@pytest.fixture
def small_log(tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]) -> tuple[Path, list[int]]:
    """One of a robot that measures and publishes nothing, which is read thousands of times in a few seconds."""
    bare = msgspec.structs.replace(layout, sensors=(), commands=(), inputs=(), published=())
    records = [
        replace(record(cycle), sensors=Sensors(), commands=(), u=(), published=()) for cycle in range(2 * SMALL_EVERY)
    ]
    return written(tmp_path / "run.mcap", bare, records, SMALL_EVERY)


def cycles(path: Path) -> int:
    return sum(topic == "/cycle" for topic, _ in Salvage(path).messages())


def test_a_whole_log_is_read_to_its_end(log: tuple[Path, list[int]]) -> None:
    salvage = Salvage(log[0])

    assert sum(topic == "/cycle" for topic, _ in salvage.messages()) == CYCLES
    assert salvage.is_whole
    assert salvage.attachments["robot.json"] == b"{}"
    assert salvage.metadata["robot"] == {"name": "testbot"}


def test_cut_at_any_byte_it_is_read_up_to_the_last_flush(small_log: tuple[Path, list[int]], tmp_path: Path) -> None:
    path, sizes = small_log
    data, cut = path.read_bytes(), tmp_path / "cut.mcap"
    cut.write_bytes(data)
    for length in reversed(range(len(data))):
        os.truncate(cut, length)
        flushed = sum(size <= length for size in sizes) * SMALL_EVERY
        salvage = Salvage(cut)
        found = sum(topic == "/cycle" for topic, _ in salvage.messages())
        # A chunk is whole some bytes before the index of its messages.
        assert flushed <= found <= flushed + SMALL_EVERY, length
        assert found % SMALL_EVERY == 0
        assert "robot.json" in salvage.attachments or found == 0
        assert not salvage.is_whole or length > sizes[-1]
    assert [cycles(path)] == [2 * SMALL_EVERY]


def test_what_was_flushed_is_whole_to_the_library_too(log: tuple[Path, list[int]], tmp_path: Path) -> None:
    path, sizes = log
    data = path.read_bytes()
    for place, size in enumerate(sizes):
        with (tmp_path / "cut.mcap").open("wb+") as stream:
            # It reads from the front where there is no summary at the end, and then misses the end.
            stream.write(data[:size])
            stream.flush()
        found = list(Salvage(tmp_path / "cut.mcap").messages())
        assert sum(topic == "/cycle" for topic, _ in found) == (place + 1) * FLUSHED_EVERY
    with path.open("rb") as whole:
        assert sum(1 for _ in make_reader(whole, validate_crcs=True).iter_messages(["/cycle"])) == CYCLES


def test_a_damaged_chunk_costs_itself_and_nothing_false_is_ever_read(log: tuple[Path, list[int]]) -> None:
    path, sizes = log
    data = path.read_bytes()
    true = [(topic, message.data) for topic, message in Salvage(path).messages()]
    # A record is an opcode, its length and that much; a chunk with LZ4 has 43 bytes before its data (mcap.dev/spec).
    length = int.from_bytes(data[sizes[0] + 1 : sizes[0] + 9], "little")
    assert data[sizes[0]] == CHUNK
    each = len(true) // (CYCLES // FLUSHED_EVERY)
    lost = 0
    for place in range(sizes[0], sizes[0] + 9 + length):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x10]) + data[place + 1 :])
        salvage = Salvage(path)
        found = [(topic, message.data) for topic, message in salvage.messages()]
        assert found in (true, [*true[:each], *true[2 * each :]]), place
        assert not salvage.is_whole
        assert not salvage.is_cut
        lost += found != true
    # What flips may mean the same: LZ4 can refer to equal bytes in another place.
    assert lost > length // 2


@pytest.mark.parametrize("step", [5, pytest.param(1, marks=pytest.mark.proof)])
def test_each_byte_of_a_log_that_flips_is_reported_and_costs_one_chunk_at_most(
    small_log: tuple[Path, list[int]], step: int
) -> None:
    path, _ = small_log
    data = path.read_bytes()
    whole = list(Salvage(path).messages())
    for place in range(0, len(data), step):
        path.write_bytes(data[:place] + bytes([data[place] ^ (1 << place % 8)]) + data[place + 1 :])
        salvage = Salvage(path)
        stamps = [message.log_time for topic, message in salvage.messages() if topic == "/cycle"]
        assert not salvage.is_whole, place
        assert len(stamps) >= SMALL_EVERY, place
        assert {"part.json", "robot.json", "layout.json", "end.json"} == set(salvage.attachments), place
    assert len(whole) > SMALL_EVERY


def test_a_log_that_is_being_written_opens_in_the_readers_that_need_an_index(
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]
) -> None:
    path = tmp_path / "run.mcap"
    with CycleLog(path, layout, Provenance({"robot.json": "{}"}, {})) as made:
        for cycle in range(CYCLES):
            made.write(record(cycle))
            made.flush()
            with path.open("rb") as stream:
                reader = make_reader(stream, validate_crcs=True)
                assert sum(1 for _ in reader.iter_messages(["/cycle"])) == cycle + 1
            with AnyReader([path]) as rosbags:
                assert rosbags.message_count >= cycle + 1
            assert Salvage(path).is_cut
            assert Salvage(path).damage == []
    assert Salvage(path).is_whole
    assert Salvage(path).counts["/cycle"] == CYCLES


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"cannot read the log .*no\.mcap: No such file or directory"):
        list(Salvage(tmp_path / "no.mcap").messages())


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(RecordingError, match=r"cannot read the log .*pipe\.mcap: it is no file$"):
        Salvage(tmp_path / "pipe.mcap")
