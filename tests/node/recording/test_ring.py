"""Messages through memory that two processes share: taken whole, in order, once, or not at all."""

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from node.recording.ring import FREE, RING_BYTES, ROOM, SLOT_BYTES, SLOTS, RingReader, RingWriter, open_ring

KIND = ord("C")
messages = st.binary(max_size=ROOM).map(lambda data: data[:-1] + b"." if data else b".")


@pytest.fixture
def memory() -> Iterator[int]:
    descriptor = open_ring()
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
    return b"message %d." % number


def put(writer: RingWriter, numbers: range) -> None:
    for number in numbers:
        assert writer.put(KIND, numbered(number))


def taken(reader: RingReader, *, is_last: bool = False) -> list[bytes]:
    return [message for _, message in reader.take(is_last=is_last)]


def test_a_message_is_taken_at_the_look_after_the_one_that_saw_it(writer: RingWriter, reader: RingReader) -> None:
    put(writer, range(2))
    assert taken(reader) == []
    put(writer, range(2, 3))
    assert taken(reader) == [numbered(0), numbered(1)]
    assert taken(reader) == [numbered(2)]
    assert taken(reader) == []


def test_at_the_end_everything_is_taken_and_nothing_held(writer: RingWriter, reader: RingReader) -> None:
    put(writer, range(5))
    assert writer.held() == 5
    assert taken(reader, is_last=True) == [numbered(number) for number in range(5)]
    assert writer.held() == 0


def test_what_was_taken_is_held_until_the_next_look(writer: RingWriter, reader: RingReader) -> None:
    put(writer, range(3))
    assert taken(reader) == []
    assert len(taken(reader)) == 3
    assert writer.held() == 3
    assert taken(reader) == []
    assert writer.held() == 0


def test_a_full_ring_takes_no_more_until_a_slot_is_free_and_loses_nothing_it_took(
    writer: RingWriter, reader: RingReader
) -> None:
    put(writer, range(SLOTS))
    assert not writer.put(KIND, b"one too many.")
    assert writer.held() == SLOTS
    assert taken(reader) == []
    assert len(taken(reader)) == SLOTS
    assert not writer.put(KIND, b"read, and not free yet.")
    assert taken(reader) == []
    put(writer, range(SLOTS, SLOTS + 3))
    assert taken(reader) == []
    assert taken(reader) == [numbered(number) for number in range(SLOTS, SLOTS + 3)]


def test_round_and_round_every_message_comes_once_and_in_order(writer: RingWriter, reader: RingReader) -> None:
    found: list[bytes] = []
    begin = 0
    for count in [700, 1, 1300, 0, 40, 900] * 3:
        put(writer, range(begin, begin + count))
        begin += count
        found += taken(reader)
    found += taken(reader, is_last=True)

    assert begin > 4 * SLOTS
    assert found == [numbered(number) for number in range(begin)]


def test_a_message_of_which_only_a_part_is_there_is_not_seen(
    memory: int, writer: RingWriter, reader: RingReader
) -> None:
    """As a loop leaves it that is killed in the middle of one."""
    put(writer, range(1))
    os.pwrite(memory, b"message 1, of which the end is miss", SLOT_BYTES + 1)

    assert taken(reader) == []
    assert taken(reader, is_last=True) == [numbered(0)]


def test_a_message_that_shows_later_than_its_kind_is_taken_whole(
    memory: int, writer: RingWriter, reader: RingReader
) -> None:
    """As a processor may show stores that orders them otherwise than x86 does."""
    del writer
    os.pwrite(memory, b"C", 0)
    assert taken(reader) == []
    os.pwrite(memory, b"here it is.", 1)
    assert taken(reader) == [b"here it is."]


def test_a_slot_that_was_used_shows_nothing_of_it(memory: int, writer: RingWriter, reader: RingReader) -> None:
    writer.put(KIND, b"x" * ROOM)
    taken(reader)
    taken(reader)
    assert os.pread(memory, SLOT_BYTES, 0) == b"C" + bytes((FREE,)) * ROOM
    taken(reader)
    assert os.pread(memory, RING_BYTES, 0) == bytes((FREE,)) * RING_BYTES


def test_the_largest_message_fits_and_a_larger_one_touches_nothing(writer: RingWriter, reader: RingReader) -> None:
    assert not writer.put(KIND, b"x" * (ROOM + 1))
    assert writer.held() == 0
    assert writer.put(KIND, b"x" * ROOM)
    assert writer.put(KIND, b"next.")
    assert taken(reader, is_last=True) == [b"x" * ROOM, b"next."]


@settings(max_examples=30)  # each fills eight megabytes
@given(st.lists(st.tuples(st.integers(0, FREE - 1), messages), max_size=5))
def test_kinds_and_messages_come_as_they_were_put(pairs: list[tuple[int, bytes]]) -> None:
    memory = open_ring()
    try:
        writer, reader = RingWriter(memory), RingReader(memory)
        for kind, message in pairs:
            assert writer.put(kind, bytearray(message))
        assert list(reader.take(is_last=True)) == [(bytes((kind,)), message) for kind, message in pairs]
    finally:
        os.close(memory)


def test_the_memory_outlives_a_process_that_put_messages_into_it_and_was_killed(
    memory: int, reader: RingReader
) -> None:
    program = (
        "import os, sys\nfrom node.recording.ring import RingWriter\nring = RingWriter(int(sys.argv[1]))\n"
        "assert all([ring.put(67, b'message %d.' % n) for n in range(9)])\nos.kill(os.getpid(), 9)\n"
    )
    ended = subprocess.run([sys.executable, "-c", program, str(memory)], pass_fds=(memory,), check=False)

    assert ended.returncode == -9
    assert taken(reader, is_last=True) == [numbered(number) for number in range(9)]
