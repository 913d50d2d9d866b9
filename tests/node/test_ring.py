"""Messages through memory that two processes share: taken whole, in order, once, or not at all."""

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from node.ring import FREE, LARGEST, ROOM, SLOT_BYTES, RingReader, RingWriter, open_ring, slot_for

KIND = ord("C")
SLOTS = 64


@pytest.fixture
def memory() -> Iterator[int]:
    descriptor = open_ring(SLOTS)
    yield descriptor
    os.close(descriptor)


@pytest.fixture
def writer(memory: int) -> RingWriter:
    return RingWriter(memory)


@pytest.fixture
def reader(memory: int, writer: RingWriter) -> RingReader:
    assert writer.held() == 0
    return RingReader(memory)


def numbered(number: int) -> bytes:
    return b"message %d" % number


def put(writer: RingWriter, numbers: range) -> None:
    for number in numbers:
        assert writer.put(KIND, numbered(number))


def taken(reader: RingReader) -> list[bytes]:
    return [message for _, message in reader.take_all()]


def test_a_message_is_taken_once_with_its_kind(writer: RingWriter, reader: RingReader) -> None:
    assert reader.take() is None
    put(writer, range(2))
    assert reader.take() == (KIND, numbered(0))
    assert writer.held() == 1
    assert taken(reader) == [numbered(1)]
    assert taken(reader) == []
    assert writer.held() == 0


def test_a_full_ring_takes_no_more_until_a_slot_is_free_and_loses_nothing_it_took(
    writer: RingWriter, reader: RingReader
) -> None:
    put(writer, range(SLOTS))
    assert not writer.put(KIND, b"one too many")
    assert writer.held() == SLOTS
    assert reader.take() == (KIND, numbered(0))
    put(writer, range(SLOTS, SLOTS + 1))
    assert taken(reader) == [numbered(number) for number in range(1, SLOTS + 1)]


def test_round_and_round_every_message_comes_once_and_in_order(writer: RingWriter, reader: RingReader) -> None:
    found: list[bytes] = []
    begin = 0
    for count in [20, 1, 43, 0, 4, 64] * 5:
        put(writer, range(begin, begin + count))
        begin += count
        found += taken(reader)

    assert begin > 4 * SLOTS
    assert found == [numbered(number) for number in range(begin)]


def test_a_message_of_which_only_a_part_is_there_is_not_seen(
    memory: int, writer: RingWriter, reader: RingReader
) -> None:
    """As a loop leaves it that is killed in the middle of one."""
    put(writer, range(1))
    os.pwrite(memory, b"\x10\x00\x12\x34\x56\x78message 1, of which", SLOT_BYTES + 1)

    assert taken(reader) == [numbered(0)]
    assert taken(reader) == []
    assert reader.damaged == 0


@pytest.mark.parametrize("late", [range(1, 7), range(7, 9), range(7, 16), range(15, 16), range(1, 16)])
def test_a_message_that_shows_later_than_its_kind_is_taken_whole(
    memory: int, writer: RingWriter, reader: RingReader, late: range
) -> None:
    """As a processor may show stores that orders them otherwise than x86 does."""
    put(writer, range(1))
    assert len(numbered(0)) == 16 - 7
    written = os.pread(memory, len(late), late.start)
    os.pwrite(memory, bytes(len(late)), late.start)
    assert taken(reader) == []
    os.pwrite(memory, written, late.start)
    assert taken(reader) == [numbered(0)]
    assert reader.damaged == 0


def test_what_a_slot_held_before_is_not_taken_again(memory: int, writer: RingWriter, reader: RingReader) -> None:
    """As where a processor shows nothing but the kind of a new message."""
    for _ in range(SLOTS):
        put(writer, range(1))
        assert taken(reader) == [numbered(0)]
    os.pwrite(memory, bytes((KIND,)), 0)
    assert taken(reader) == []


def test_a_message_that_never_comes_whole_is_passed_over_and_counted(
    memory: int, writer: RingWriter, reader: RingReader
) -> None:
    put(writer, range(3))
    os.pwrite(memory, b"?", SLOT_BYTES + 9)
    assert taken(reader) == [numbered(0)]
    assert taken(reader) == []
    assert taken(reader) == [numbered(2)]
    assert reader.damaged == 1
    put(writer, range(3, SLOTS + 3))
    assert len(taken(reader)) == SLOTS


def test_the_largest_message_fits_and_a_larger_one_touches_nothing(writer: RingWriter, reader: RingReader) -> None:
    assert writer.room == ROOM
    assert not writer.put(KIND, b"x" * (ROOM + 1))
    assert writer.held() == 0
    assert writer.put(KIND, b"x" * ROOM)
    assert writer.put(KIND, b"next")
    assert taken(reader) == [b"x" * ROOM, b"next"]


@pytest.mark.parametrize("size", [0, ROOM, ROOM + 1, LARGEST])
def test_a_slot_for_messages_has_room_for_them_and_for_what_any_slot_has(size: int) -> None:
    slot_bytes = slot_for(size)
    memory = open_ring(1, slot_bytes)
    try:
        writer, reader = RingWriter(memory, slot_bytes), RingReader(memory, slot_bytes)
        assert writer.room == max(size, ROOM)
        assert not writer.put(KIND, b"x" * (writer.room + 1))
        assert writer.put(KIND, b"x" * writer.room)
        assert reader.take() == (KIND, b"x" * writer.room)
    finally:
        os.close(memory)


def test_slots_may_be_larger() -> None:
    memory = open_ring(3, 65_536)
    try:
        writer, reader = RingWriter(memory, 65_536), RingReader(memory, 65_536)
        for _ in range(4):
            assert writer.put(KIND, b"x" * 60_000)
            assert reader.take() == (KIND, b"x" * 60_000)
    finally:
        os.close(memory)


@settings(max_examples=30)
@given(st.lists(st.tuples(st.integers(FREE + 1, 255), st.binary(max_size=ROOM)), max_size=5))
def test_kinds_and_messages_come_as_they_were_put(pairs: list[tuple[int, bytes]]) -> None:
    memory = open_ring(SLOTS)
    try:
        writer, reader = RingWriter(memory), RingReader(memory)
        for kind, message in pairs:
            assert writer.put(kind, bytearray(message))
        assert list(reader.take_all()) == pairs
    finally:
        os.close(memory)


def test_the_memory_outlives_a_process_that_put_messages_into_it_and_was_killed(
    memory: int, reader: RingReader
) -> None:
    program = (
        "import os, sys\nfrom node.ring import RingWriter\nring = RingWriter(int(sys.argv[1]))\n"
        "assert all([ring.put(67, b'message %d' % n) for n in range(9)])\nos.kill(os.getpid(), 9)\n"
    )
    ended = subprocess.run([sys.executable, "-c", program, str(memory)], pass_fds=(memory,), check=False)

    assert ended.returncode == -9
    assert taken(reader) == [numbered(number) for number in range(9)]
