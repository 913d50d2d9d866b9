# SPDX-License-Identifier: MIT
import itertools
import random
import re
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.wheel_board.frames import FrameId, WheelCommand, decode, encode
from segway_ecc.firmware_io.drives.wheel_board.serial_codec import REQUEST_ID, BoardSerialCodec
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.serial_link import LOST, SerialCodec
from tests.fuzzing import fuzzed

NOW_NS = 123_456_789


def _crc(body: bytes) -> int:
    """CRC-16/IBM-3740 by long division of the whole message, 0xFFFF put onto its first two bytes."""
    length = 8 * len(body)
    bits = (int.from_bytes(body, "big") << 16) ^ (0xFFFF << length)
    for place in reversed(range(length)):
        if bits >> (place + 16) & 1:
            bits ^= 0x11021 << place
    return bits


def _packet(sequence: int, identifier: int, data: bytes) -> bytes:
    body = bytes((sequence, identifier & 0xFF, identifier >> 8)) + data
    crc = _crc(body)
    runs = re.findall(rb"[^\x00]*\x00", body + bytes((crc & 0xFF, crc >> 8, 0)))
    return b"\x00" + b"".join(bytes((len(run),)) + run[:-1] for run in runs) + b"\x00"


@pytest.fixture
def line() -> BoardSerialCodec:
    """A line that has received nothing."""
    return BoardSerialCodec()


def test_the_reference_in_this_file_meets_the_published_check_value() -> None:
    assert _crc(b"123456789") == 0x29B1


def test_packets_are_as_described(line: BoardSerialCodec) -> None:
    board: SerialCodec = line
    frame = Frame(0x110, bytes.fromhex("00 11 00 22 33 44 55 66"))
    assert board.encode(frame) == _packet(0, 0x110, frame.data)
    assert board.request() == _packet(1, 0x7FE, b"")
    assert board.encode(Frame(0x7FF, b"")) == _packet(2, 0x7FF, b"")
    assert _packet(0, 0x110, b"\x00").hex(" ") == "00 01 03 10 01 03 92 f4 00"


def test_every_frame_comes_out_unchanged(line: BoardSerialCodec) -> None:
    other = BoardSerialCodec()
    for identifier, length in itertools.product(range(0x800), range(9)):
        if identifier == REQUEST_ID:
            continue
        frame = Frame(identifier, bytes((identifier * 7 + place * 37) & 0xFF for place in range(length)))
        packet = line.encode(frame)
        assert packet is not None
        assert packet[0] == packet[-1] == 0
        assert 0 not in packet[1:-1]
        assert len(packet) == 8 + length
        assert other.decode(packet, NOW_NS) == [replace(frame, received_ns=NOW_NS)]
    assert not +other.refused


def test_the_frames_own_protection_is_carried_too(line: BoardSerialCodec) -> None:
    command = WheelCommand(1.5, -2.0, enable=True)
    packet = line.encode(Frame(FrameId.WHEEL_COMMAND, encode(FrameId.WHEEL_COMMAND, command, 9)))
    assert packet is not None
    (frame,) = BoardSerialCodec().decode(packet, NOW_NS)
    assert decode(frame.arbitration_id, frame.data) == (command, 9)


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x110, b"", is_extended=True),
        Frame(0x110, b"", is_remote=True),
        Frame(REQUEST_ID, b""),
        Frame(REQUEST_ID, b"12345678"),
    ],
)
def test_other_frames_are_not_carried(line: BoardSerialCodec, frame: Frame) -> None:
    assert line.encode(frame) is None
    assert line.request() == _packet(0, REQUEST_ID, b"")


def test_a_request_is_counted_and_is_no_frame(line: BoardSerialCodec) -> None:
    assert BoardSerialCodec().decode(line.request() + line.request(), NOW_NS) == []
    board = BoardSerialCodec()
    board.decode(line.request(), NOW_NS)
    assert board.requests == 1
    assert line.decode(line.request(), NOW_NS) == []


@pytest.mark.parametrize(
    ("packet", "cause"),
    [
        (_packet(0, 0x800, b"12345678"), "unknown"),
        (_packet(0, 0xFFFF, b""), "unknown"),
        (_packet(0, REQUEST_ID, b"1"), "length"),
        (_packet(0, 0x110, b"123456789"), "length"),
        (b"\x00\x01\x00", "length"),
        (b"\x00\x05\x11\x22\x33\x44\x00", "length"),
        (b"\x00\x06\x11\x22\x33\x44\x55\x00", "crc"),
        (b"\x00\x07\x11\x22\x33\x44\x55\x00", "cobs"),
        (b"\x00" + b"\x11" * 100 + b"\x00", "length"),
    ],
)
def test_what_is_not_a_packet_is_refused_by_cause(line: BoardSerialCodec, packet: bytes, cause: str) -> None:
    good = _packet(0, 0x110, b"good")
    assert line.decode(packet + good, NOW_NS) == [Frame(0x110, b"good", NOW_NS)]
    assert line.refused == {cause: 1}
    assert line.requests == 0


def test_gaps_in_the_sequence_are_counted(line: BoardSerialCodec) -> None:
    for sequence in (250, 251, 254, 1, 2):
        assert line.decode(_packet(sequence, 0x120, b""), NOW_NS)
    assert line.refused[LOST] == 4
    line.reset()
    line.decode(_packet(77, 0x120, b""), NOW_NS)
    assert line.refused[LOST] == 4


def test_a_packet_that_was_refused_is_missing_in_the_sequence(line: BoardSerialCodec) -> None:
    line.decode(_packet(4, 0x120, b"") + _packet(5, 0x820, b"") + _packet(6, REQUEST_ID, b""), NOW_NS)
    assert line.refused == {"unknown": 1, LOST: 1}


def test_the_sequence_of_what_is_sent_goes_round(line: BoardSerialCodec) -> None:
    packets = [line.request() for _ in range(257)]
    assert packets[255] == _packet(255, REQUEST_ID, b"")
    assert packets[256] == packets[0] == _packet(0, REQUEST_ID, b"")


def test_a_reset_forgets_half_a_packet(line: BoardSerialCodec) -> None:
    packet = _packet(0, 0x110, b"12345678")
    line.decode(packet[:9], NOW_NS)
    line.reset()
    assert line.decode(packet[9:] + packet, NOW_NS + 1) == [Frame(0x110, b"12345678", NOW_NS + 1)]


DATA = (bytes(8), b"\xff" * 8, bytes.fromhex("00 01 00 02 80 00 7f 01"))


def _flipped(packet: bytes) -> Iterator[bytes]:
    whole = int.from_bytes(packet, "big")
    for bit in range(8 * len(packet)):
        yield (whole ^ (1 << bit)).to_bytes(len(packet), "big")


@pytest.mark.parametrize("length", range(9))
def test_every_flipped_bit_is_refused_and_costs_no_other_packet(length: int) -> None:
    before, after = _packet(254, 0x120, b"before"), _packet(0, 0x121, b"after")
    expected = [Frame(0x120, b"before", NOW_NS), Frame(0x121, b"after", NOW_NS)]
    for sequence, identifier, data in itertools.product((0, 1, 16, 255), (0, 1, 0x100, 0x110, 0x7FF, REQUEST_ID), DATA):
        if identifier == REQUEST_ID and length:
            continue
        for broken in _flipped(_packet(sequence, identifier, data[:length])):
            line = BoardSerialCodec()
            assert line.decode(before + broken + after, NOW_NS) == expected, broken.hex(" ")
            assert line.requests == 0, broken.hex(" ")
            assert line.refused.total() - line.refused[LOST] >= 1, broken.hex(" ")


@pytest.mark.parametrize("length", range(9))
def test_a_byte_too_many_or_too_few_is_refused_and_costs_no_other_packet(length: int) -> None:
    after = _packet(0, 0x121, b"after")
    for sequence, identifier, data in itertools.product((0, 16), (0x100, 0x110), DATA):
        packet = _packet(sequence, identifier, data[:length])
        shorter = [packet[:place] + packet[place + 1 :] for place in range(1, len(packet) - 1)]
        longer = [packet[:p] + bytes((b,)) + packet[p:] for p in range(2, len(packet) - 1) for b in (0, 1, 2, 9, 255)]
        for broken in shorter + longer:
            assert BoardSerialCodec().decode(broken + after, NOW_NS) == [Frame(0x121, b"after", NOW_NS)], broken.hex(
                " "
            )


def test_what_a_flipped_bit_makes_of_a_command_never_passes_both_checks() -> None:
    """The packet's CRC is short; what slipped through it would still meet the frame's own."""
    for counter, volts in itertools.product(range(16), (0.0, 0.256, -1.5, 29.0)):
        data = encode(FrameId.WHEEL_COMMAND, WheelCommand(volts, -volts, enable=True), counter)
        for broken in _flipped(_packet(counter, FrameId.WHEEL_COMMAND, data)):
            for frame in BoardSerialCodec().decode(broken + b"\x00", NOW_NS):
                with pytest.raises(FrameRefusedError):
                    decode(frame.arbitration_id, frame.data)


def _noise(rng: random.Random) -> bytes:
    letters = rng.choice([range(256), (0, 1, 2, 3, 255), range(1, 256), range(1, 14)])
    return bytes(rng.choice(letters) for _ in range(rng.randint(1, 30)))


def _part(rng: random.Random) -> tuple[bytes, bytes, Frame]:
    """A part of what a line may bring, the packet that it is made of, and what that carries."""
    identifier = rng.choice([0, 0x100, *FrameId, rng.randrange(0x7FE)])
    data = bytes(rng.choice([0, rng.randrange(256)]) for _ in range(rng.randint(0, 8)))
    packet = _packet(rng.choice([0, rng.randrange(256)]), identifier, data)
    place = rng.randint(2, len(packet) - 2)
    part = {
        "good": packet,
        "noise": _noise(rng),
        "head": packet[:place],
        "tail": packet[place:],
        "inserted": packet[:place] + _noise(rng)[: rng.choice([1, 30])] + packet[place:],
    }
    return part[rng.choice(["good", "good", "good", *part])], packet, Frame(identifier, data, NOW_NS)


@fuzzed
@given(st.integers(0, 2**64))
def test_every_whole_packet_arrives_whatever_is_between_and_nothing_else(seed: int) -> None:
    rng = random.Random(seed)  # noqa: S311 - nothing secret
    parts = [_part(rng) for _ in range(rng.randint(1, 6))]
    stream = b"".join(part for part, _, _ in parts)
    # Noise may by chance bring back what it replaced; what stands whole between two zeros is what counts.
    carried = {packet[1:-1]: frame for _, packet, frame in parts}
    expected = [carried[piece] for piece in stream.split(b"\x00")[:-1] if piece in carried]
    assert len(expected) >= sum(part == packet for part, packet, _ in parts)
    line, frames = BoardSerialCodec(), []
    while stream:
        size = rng.randint(1, 2 * len(stream))
        frames += line.decode(stream[:size], NOW_NS)
        stream = stream[size:]
    assert frames == expected
    assert line.requests == 0


@settings(max_examples=1_000)
@given(st.binary(max_size=300))
def test_noise_gives_nothing(noise: bytes) -> None:
    line = BoardSerialCodec()
    assert line.decode(noise, NOW_NS) == []
    assert line.requests == 0
