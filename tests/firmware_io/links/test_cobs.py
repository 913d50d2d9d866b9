# SPDX-License-Identifier: MIT
import re
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from segway_ecc.firmware_io.links.cobs import CobsError, CobsReceiver, decode, encode
from tests.fuzzing import fuzzed


def _bytes(first: int, last: int) -> bytes:
    return bytes(range(first, last + 1))


VECTORS = {
    "": "01",
    "00": "01 01",
    "00 00": "01 01 01",
    "00 11 00": "01 02 11 01",
    "11 22 00 33": "03 11 22 02 33",
    "11 22 33 44": "05 11 22 33 44",
    "11 00 00 00": "02 11 01 01 01",
    _bytes(0x01, 0xFE).hex(): "ff" + _bytes(0x01, 0xFE).hex(),
    "00" + _bytes(0x01, 0xFE).hex(): "01 ff" + _bytes(0x01, 0xFE).hex(),
    _bytes(0x01, 0xFF).hex(): "ff" + _bytes(0x01, 0xFE).hex() + "02 ff",
    _bytes(0x02, 0xFF).hex() + "00": "ff" + _bytes(0x02, 0xFF).hex() + "01 01",
    _bytes(0x03, 0xFF).hex() + "00 01": "fe" + _bytes(0x03, 0xFF).hex() + "02 01",
}
"""Published examples of the method; the fifth is also in the reference of the wheel board."""

LONG = st.lists(st.sampled_from([b"\x00", b"\x01" * 253, b"\x02" * 254, b"\x03" * 255, b"\xff"]), max_size=6)


def _by_definition(data: bytes) -> bytes:
    """The blocks cut out by a pattern: 254 bytes with no zero, or fewer up to a zero, which is put after the last."""
    blocks = re.findall(rb"[^\x00]{254}|[^\x00]{0,253}\x00", data + b"\x00", flags=re.DOTALL)
    if len(blocks) > 1 and len(blocks[-2]) == 254 and blocks[-2][-1:] != b"\x00" and blocks[-1] == b"\x00":
        del blocks[-1]
    return b"".join(bytes((255,)) + b if not b.endswith(b"\x00") else bytes((len(b),)) + b[:-1] for b in blocks)


@pytest.mark.parametrize(("plain", "coded"), VECTORS.items())
def test_published_examples_are_met_both_ways(plain: str, coded: str) -> None:
    assert encode(bytes.fromhex(plain)).hex() == bytes.fromhex(coded).hex()
    assert decode(bytes.fromhex(coded)) == bytes.fromhex(plain)


def _check(data: bytes) -> None:
    coded = encode(data)
    assert coded == _by_definition(data)
    assert 0 not in coded
    assert len(coded) <= len(data) + 1 + len(data) // 254
    assert decode(coded) == data


@fuzzed
@given(st.binary(max_size=20))
def test_every_packet_is_stuffed_as_defined_and_comes_back(data: bytes) -> None:
    _check(data)


@settings(max_examples=500)
@given(LONG.map(b"".join))
def test_long_packets_are_too(data: bytes) -> None:
    _check(data)


@fuzzed
@given(st.binary(max_size=12), st.sampled_from([4, 8, 256]))
def test_anything_else_is_refused_in_one_way(coded: bytes, values: int) -> None:
    coded = bytes(byte % values for byte in coded)
    try:
        data = decode(coded)
    except CobsError:
        return
    assert encode(data) == coded


@settings(max_examples=300)
@given(LONG.map(lambda runs: b"".join(runs).replace(b"\x00", b"\x01")))
def test_long_ones_are_too(coded: bytes) -> None:
    try:
        data = decode(coded)
    except CobsError:
        return
    assert encode(data) in (coded, coded.removesuffix(b"\x01"))


@pytest.mark.parametrize("coded", ["", "00", "02", "03 11", "02 11 02", "02 00", "03 11 00", "01 00 01"])
def test_broken_stuffing_is_refused(coded: str) -> None:
    with pytest.raises(CobsError):
        decode(bytes.fromhex(coded))


@pytest.fixture
def refused() -> Counter[str]:
    """What was refused, by cause."""
    return Counter()


@settings(max_examples=300)
@given(st.lists(st.binary(max_size=12), max_size=8), st.data())
def test_a_stream_in_pieces_of_any_size_gives_the_same_packets(packets: list[bytes], data: st.DataObject) -> None:
    refused: Counter[str] = Counter()
    receiver = CobsReceiver(14, refused)
    stream = b"".join(encode(packet) + b"\x00" for packet in packets)
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=6).map(sorted))
    pieces = [stream[begin:end] for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    assert [packet for piece in pieces for packet in receiver.take_bytes(piece)] == packets
    assert not refused


def test_a_receiver_finds_the_next_packet_after_what_it_refuses(refused: Counter[str]) -> None:
    receiver = CobsReceiver(5, refused)
    assert receiver.take_bytes(b"\x05\x11\x22\x33\x44\x00") == [b"\x11\x22\x33\x44"]
    assert receiver.take_bytes(b"\x06\x11\x22\x33\x44\x55\x00\x02\x11\x00") == [b"\x11"]
    assert refused == {"length": 1}
    assert receiver.take_bytes(b"\x04\x11\x00\x02\x22\x00") == [b"\x22"]
    assert refused == {"length": 1, "cobs": 1}


def test_zeros_in_a_row_hold_no_packet_and_are_no_fault(refused: Counter[str]) -> None:
    receiver = CobsReceiver(5, refused)
    assert receiver.take_bytes(bytes(1000)) == []
    assert receiver.take_bytes(b"\x01\x00") == [b""]
    assert not refused


def test_an_endless_packet_is_not_kept(refused: Counter[str]) -> None:
    receiver = CobsReceiver(5, refused)
    for _ in range(1000):
        assert receiver.take_bytes(b"\x05\x11\x22") == []
        assert len(receiver._begun) <= 5
    assert receiver.take_bytes(b"\x02\x11\x00\x02\x22\x00") == [b"\x22"]
    assert refused == {"length": 1}


def test_a_piece_that_would_fit_does_not_revive_a_packet_that_was_too_long(refused: Counter[str]) -> None:
    receiver = CobsReceiver(5, refused)
    assert receiver.take_bytes(b"\x05\x11\x22") == []
    assert receiver.take_bytes(b"\x33\x44\x55") == []
    assert receiver.take_bytes(b"\x33\x44\x00") == []
    assert refused == {"length": 1}


@pytest.mark.parametrize("begun", [b"\x03\x11", b"\x03" * 9])
def test_a_reset_forgets_what_has_begun(refused: Counter[str], begun: bytes) -> None:
    receiver = CobsReceiver(5, refused)
    receiver.take_bytes(begun)
    receiver.reset()
    assert receiver.take_bytes(b"\x02\x22\x00") == [b"\x22"]
    assert not refused
