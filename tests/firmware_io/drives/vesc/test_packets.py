# SPDX-License-Identifier: MIT
"""The framing and its receiver; the published packets are those of VESC's UART."""

import itertools
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.vesc.packets import MAX_PACKET, PacketReceiver, frame_packet
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from tests.fuzzing import fuzzed

PUBLISHED = [
    ("04", "02 01 04 40 84 03"),
    ("06 00 00 C7 38", "02 05 06 00 00 C7 38 F5 1D 03"),
    ("1E", "02 01 1E F3 FF 03"),
    ("22 17 06 00 00 03 E8", "02 07 22 17 06 00 00 03 E8 38 20 03"),
    ("32 00 00 21 A0", "02 05 32 00 00 21 A0 C8 50 03"),
]
GOOD = frame_packet(bytes.fromhex("3200008000 05"))


@pytest.mark.parametrize(("packet", "framed"), PUBLISHED)
def test_packets_are_the_published_ones(packet: str, framed: str) -> None:
    assert frame_packet(bytes.fromhex(packet)) == bytes.fromhex(framed)
    assert PacketReceiver().feed(bytes.fromhex(framed)) == [bytes.fromhex(packet)]


@pytest.mark.parametrize(("length", "head"), [(1, "0201"), (255, "02FF"), (256, "030100"), (512, "030200")])
def test_length_is_read_from_the_head(length: int, head: str) -> None:
    packet = bytes(range(256)) * 2
    framed = frame_packet(packet[:length])
    assert framed[: len(head) // 2].hex().upper() == head
    assert framed[-1] == 3
    assert PacketReceiver().feed(framed) == [packet[:length]]


@pytest.mark.parametrize("length", [0, MAX_PACKET + 1])
def test_a_packet_that_no_controller_takes_is_refused(length: int) -> None:
    with pytest.raises(FrameRefusedError) as refused:
        frame_packet(bytes(length))
    assert refused.value.refusal is Refusal.LENGTH


def test_a_long_head_is_for_long_packets_only() -> None:
    short = frame_packet(b"\x04")
    assert PacketReceiver().feed(b"\x03\x00\x01" + short[2:]) == []


def test_a_damaged_packet_is_counted_and_the_next_one_found() -> None:
    receiver = PacketReceiver()
    damaged = bytes((*GOOD[:3], GOOD[3] ^ 1, *GOOD[4:]))
    assert receiver.feed(damaged + GOOD) == [GOOD[2:-3]]
    assert receiver.refused == {Refusal.CRC: 1}


@pytest.mark.parametrize(
    "begun",
    [
        bytes.fromhex("02FF"),  # claims 255 bytes
        bytes.fromhex("030200"),  # claims 512 bytes
        bytes.fromhex("02"),
        bytes.fromhex("0302"),
        GOOD[:-1],
        GOOD[:4],
        bytes.fromhex("0202"),
        bytes.fromhex("0303030303"),
    ],
)
def test_a_beginning_that_claims_more_does_not_hold_up_what_follows(begun: bytes) -> None:
    receiver = PacketReceiver()
    assert receiver.feed(begun) == []
    assert receiver.feed(GOOD) == [GOOD[2:-3]]


def test_what_seems_to_be_a_packet_within_another_one_does_not_hide_it() -> None:
    """Such as 5.15 A, no duty, 3 turns: `02 03`, zeros whose CRC is zero, `03`."""
    packet = bytes.fromhex("32 0022A1C4 00000203 0000 00000003 0168 00000000 00 01 00")
    assert PacketReceiver().feed(frame_packet(packet)) == [bytes(3), packet]


def test_packets_that_end_together_are_both_given_out() -> None:
    inner = frame_packet(b"\x04")
    # Whatever the CRC of the outer one comes to, it has to end with the inner one: so it is searched for.
    for filler in itertools.product(range(256), repeat=2):
        outer = bytes((2, len(inner) - 1)) + bytes(filler) + inner
        if len(found := PacketReceiver().feed(outer)) == 2:
            assert found == [bytes(filler) + inner[:-3], b"\x04"]
            return
    pytest.fail("no outer packet has the CRC of the inner one")


def test_bytes_after_a_reset_are_a_new_beginning() -> None:
    receiver = PacketReceiver()
    receiver.feed(GOOD[:5])
    receiver.reset()
    assert receiver.feed(GOOD[5:]) == []
    assert receiver.feed(GOOD) == [GOOD[2:-3]]


def test_every_single_bit_flip_is_refused() -> None:
    for packet in (b"\x04", bytes.fromhex("06 00 00 C7 38"), bytes(range(40)), bytes(300)):
        framed = frame_packet(packet)
        for bit in range(8 * len(framed)):
            flipped = bytearray(framed)
            flipped[bit // 8] ^= 1 << bit % 8
            receiver = PacketReceiver()
            assert receiver.feed(bytes(flipped)) == []
            assert GOOD[2:-3] in receiver.feed(GOOD)


def test_what_is_kept_is_bounded_whatever_comes() -> None:
    receiver = PacketReceiver()
    for piece in (b"\x02\xff", b"\x03\x02", b"\x02\x02", b"\x03\x03", b"\x03\x01\x02"):
        receiver.feed(piece * 5_000)
        assert len(receiver._kept) <= 2 * 520
        assert sum(len(begun) for begun in receiver._ends.values()) <= 2 * 520
    assert receiver.feed(GOOD) == [GOOD[2:-3]]
    assert receiver.refused["garbage"] == (5_000 * 11 - 2 * 518) // 518 + 1


def test_a_line_with_packets_on_it_has_no_garbage_and_one_without_has() -> None:
    receiver = PacketReceiver()
    for _ in range(300):
        receiver.feed(GOOD + b"\0")
    assert receiver.refused == {}
    receiver.feed(bytes(3 * 518 + 1))
    assert receiver.refused == {"garbage": 1}


def _packet(chance: random.Random) -> bytes:
    if chance.random() < 0.5:
        return bytes(chance.choices((2, 3, 0, 1, 255), k=chance.randint(1, 20)))
    return chance.randbytes(chance.randint(1, 30))


def _noise(chance: random.Random) -> bytes:
    framed = frame_packet(_packet(chance))
    cut = chance.randint(0, len(framed) - 1)
    inserted = framed[:cut] + chance.randbytes(1) + framed[cut:]
    head = bytes(chance.choices((2, 3, 0, 1, 5, 255), k=chance.randint(0, 12)))
    return chance.choice((b"", chance.randbytes(chance.randint(1, 20)), head, framed[:cut], inserted))


def _check_stream(parts: list[tuple[bytes, bytes]], tail: bytes, size: int) -> None:
    stream = b"".join(noise + frame_packet(packet) for noise, packet in parts) + tail
    whole = PacketReceiver().feed(stream)
    found = iter(whole)
    for _, packet in parts:
        assert packet in found, "in order, among what the noise has of its own"
    assert all(frame_packet(packet) in stream for packet in whole), "and nothing that is not there"

    receiver = PacketReceiver()
    pieces = [stream[start : start + size] for start in range(0, len(stream), size)]
    assert [packet for piece in pieces for packet in receiver.feed(piece)] == whole, "however it is cut"


@fuzzed
@given(st.integers(0, 2**64))
def test_every_good_packet_is_found_among_anything(seed: int) -> None:
    """Damaged, cut and extended packets and false beginnings, before, between and behind good ones."""
    chance = random.Random(seed)  # noqa: S311 - a test's chance, not a secret
    parts = [(_noise(chance), _packet(chance)) for _ in range(chance.randint(1, 3))]
    _check_stream(parts, _noise(chance), chance.randint(1, 40))


@settings(max_examples=100)
@given(st.integers(0, 2**64))
def test_long_packets_too(seed: int) -> None:
    chance = random.Random(seed)  # noqa: S311 - a test's chance, not a secret
    parts = [(_noise(chance), chance.randbytes(chance.randint(200, MAX_PACKET))) for _ in range(2)]
    _check_stream(parts, _noise(chance), chance.randint(1, 300))
