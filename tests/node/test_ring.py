# SPDX-License-Identifier: MIT
"""Messages through memory that two processes share: taken whole, in order, once, or not at all."""

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from segway_ecc.node.ring import CONTINUED, FREE, LARGEST, SLOT_BYTES, RingReader, RingWriter, open_ring, slots_for

KIND = ord("C")
SLOTS = 64
HEAD = 6
"""Bytes before a message in its first slot: its length and CRC."""
ROOM = SLOT_BYTES - HEAD
"""Of one slot."""


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
    return [message for _, message in reader.take_messages()]


def test_a_message_is_taken_once_with_its_kind(writer: RingWriter, reader: RingReader) -> None:
    assert reader.take_message() is None
    put(writer, range(2))
    assert reader.take_message() == (KIND, numbered(0))
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
    assert reader.take_message() == (KIND, numbered(0))
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
    os.pwrite(memory, b"\x10\x00\x12\x34\x56\x78message 1, of which", SLOTS + SLOT_BYTES)

    assert taken(reader) == [numbered(0)]
    assert taken(reader) == []
    assert reader.damaged == 0


@pytest.mark.parametrize("late", [range(6), range(6, 8), range(6, 15), range(14, 15), range(15)])
def test_a_message_that_shows_later_than_its_kind_is_taken_whole(
    memory: int, writer: RingWriter, reader: RingReader, late: range
) -> None:
    """As a processor may show stores that orders them otherwise than x86 does."""
    put(writer, range(1))
    assert len(numbered(0)) == 15 - HEAD
    written = os.pread(memory, len(late), SLOTS + late.start)
    os.pwrite(memory, bytes(len(late)), SLOTS + late.start)
    assert taken(reader) == []
    os.pwrite(memory, written, SLOTS + late.start)
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
    os.pwrite(memory, b"?", SLOTS + SLOT_BYTES + 9)
    assert taken(reader) == [numbered(0)]
    assert taken(reader) == []
    assert taken(reader) == [numbered(2)]
    assert reader.damaged == 1
    put(writer, range(3, SLOTS + 3))
    assert len(taken(reader)) == SLOTS


@pytest.mark.parametrize("size", [0, 1, ROOM, ROOM + 1, ROOM + SLOT_BYTES, ROOM + SLOT_BYTES + 1, 5000, LARGEST])
def test_message_takes_slots_for_its_size(size: int) -> None:
    memory = open_ring(3 * slots_for(size))
    try:
        writer, reader = RingWriter(memory), RingReader(memory)
        message = os.urandom(size)
        assert [writer.put(KIND, message) for _ in range(4)] == [True, True, True, False]
        assert writer.held() == 3
        assert taken(reader) == [message] * 3
    finally:
        os.close(memory)


def test_one_that_takes_the_whole_ring_fits_and_a_larger_one_touches_nothing(
    writer: RingWriter, reader: RingReader
) -> None:
    assert writer.room == SLOTS * SLOT_BYTES - HEAD
    put(writer, range(1))
    assert taken(reader) == [numbered(0)]
    for _ in range(3):
        assert not writer.put(KIND, b"x" * (writer.room + 1))
        assert writer.held() == 0
        assert writer.put(KIND, b"x" * writer.room)
        assert not writer.put(KIND, b"")
        assert taken(reader) == [b"x" * writer.room]


def test_no_message_is_longer_than_its_length_can_tell() -> None:
    memory = open_ring(2 * slots_for(LARGEST))
    try:
        assert not RingWriter(memory).put(KIND, bytes(LARGEST + 1))
    finally:
        os.close(memory)


def test_a_long_message_finds_no_room_where_only_its_first_slots_are_free(
    writer: RingWriter, reader: RingReader
) -> None:
    put(writer, range(SLOTS))
    for number in range(2):
        assert reader.take_message() == (KIND, numbered(number))
    assert not writer.put(KIND, b"x" * (ROOM + SLOT_BYTES + 1))
    assert writer.put(KIND, b"x" * (ROOM + SLOT_BYTES))
    assert taken(reader)[-1] == b"x" * (ROOM + SLOT_BYTES)


def test_a_long_message_that_never_comes_whole_is_passed_over_whole(
    memory: int, writer: RingWriter, reader: RingReader
) -> None:
    """Whatever its length has become."""
    assert writer.put(KIND, b"x" * 1000)
    put(writer, range(1))
    os.pwrite(memory, b"\xff\xff", SLOTS)
    assert taken(reader) == []
    assert taken(reader) == []
    assert reader.damaged == 1
    assert taken(reader) == [numbered(0)]


@settings(max_examples=100)
@given(st.lists(st.tuples(st.integers(FREE + 1, CONTINUED - 1), st.binary(max_size=10 * SLOT_BYTES)), max_size=5))
def test_kinds_and_messages_come_as_they_were_put(pairs: list[tuple[int, bytes]]) -> None:
    memory = open_ring(SLOTS)
    try:
        writer, reader = RingWriter(memory), RingReader(memory)
        for _ in range(3):  # round and round
            for kind, message in pairs:
                assert writer.put(kind, bytearray(message))
            assert list(reader.take_messages()) == pairs
    finally:
        os.close(memory)


def test_the_memory_outlives_a_process_that_put_messages_into_it_and_was_killed(
    memory: int, reader: RingReader
) -> None:
    program = (
        "import os, sys\nfrom segway_ecc.node.ring import RingWriter\nring = RingWriter(int(sys.argv[1]))\n"
        "assert all([ring.put(67, b'message %d' % n) for n in range(9)])\nos.kill(os.getpid(), 9)\n"
    )
    ended = subprocess.run([sys.executable, "-c", program, str(memory)], pass_fds=(memory,), check=False)

    assert ended.returncode == -9
    assert taken(reader) == [numbered(number) for number in range(9)]
