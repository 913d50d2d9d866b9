# SPDX-License-Identifier: MIT
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from segway_ecc.firmware_io.integrity import CounterCheck, crc16_xmodem, frame_crc

Crc = Callable[[bytes], int]

steady = settings(derandomize=True, deadline=None)


def crc8(data: bytes) -> int:
    """The sum of plain data, whose last two bytes stand where a frame has its identifier."""
    return frame_crc(int.from_bytes(data[-2:], "little"), data[:-2])


def test_the_published_check_value_is_met() -> None:
    assert crc8(b"123456789") == 0xDF


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ("00 00 00 00", 0x12),
        ("F2 01 83", 0xC2),
        ("0F AA 00 55", 0xC6),
        ("00 FF 55 11", 0x77),
        ("33 22 55 AA BB CC DD EE FF", 0x11),
        ("92 6B 55", 0x33),
        ("FF FF FF FF", 0x6C),
    ],
)
def test_autosars_own_examples_are_met(data: str, expected: int) -> None:
    """AUTOSAR "Specification of CRC Routines", table for CRC8H2F."""
    assert crc8(bytes.fromhex(data)) == expected


@steady
@given(st.binary(min_size=2, max_size=64))
def test_equals_bitwise_division(reference_crc: Crc, data: bytes) -> None:
    assert crc8(data) == reference_crc(data)


@steady
@given(st.integers(0, 0x7FF), st.binary(max_size=7))
def test_the_identifier_follows_the_data_low_byte_first(reference_crc: Crc, identifier: int, data: bytes) -> None:
    assert frame_crc(identifier, data) == reference_crc(data + bytes((identifier & 0xFF, identifier >> 8)))


@pytest.mark.parametrize("first", range(16))
def test_the_first_count_is_taken_whatever_it_is(first: int) -> None:
    check = CounterCheck()
    assert check.accepts(first)
    assert check.lost == 0


@pytest.mark.parametrize("ahead", range(1, 7))
@pytest.mark.parametrize("last", range(16))
def test_up_to_five_missing_frames_are_bridged_and_counted(last: int, ahead: int) -> None:
    check = CounterCheck()
    check.accepts(last)
    assert check.accepts((last + ahead) % 16)
    assert check.lost == ahead - 1


@pytest.mark.parametrize("ahead", [0, *range(7, 16)])
@pytest.mark.parametrize("last", range(16))
def test_a_repeated_or_too_distant_count_is_refused_and_followed(last: int, ahead: int) -> None:
    check = CounterCheck()
    check.accepts(last)
    assert not check.accepts((last + ahead) % 16)
    assert check.lost == 0, "what is missing before a refused count is not known"
    assert check.accepts((last + ahead + 1) % 16), "a sender that restarted is followed from its second frame"
    assert check.lost == 0


def test_a_whole_turn_of_the_counter_is_taken() -> None:
    check = CounterCheck()
    assert all(check.accepts(count % 16) for count in range(40))
    assert check.lost == 0


def test_losses_add_up() -> None:
    check = CounterCheck()
    assert [check.accepts(count) for count in (0, 2, 3, 6)] == [True] * 4
    assert check.lost == 1 + 0 + 2


def test_the_published_check_value_of_crc16_xmodem_is_met() -> None:
    """Catalogue of parametrised CRC algorithms: check 0x31C3."""
    assert crc16_xmodem(b"123456789") == 0x31C3


@steady
@given(st.binary(max_size=64))
def test_crc16_xmodem_is_the_remainder_of_division_by_its_polynomial(data: bytes) -> None:
    bits = int.from_bytes(data, "big") << 16
    for place in reversed(range(8 * len(data))):
        if bits >> (place + 16) & 1:
            bits ^= 0x11021 << place  # x^16 + x^12 + x^5 + 1
    assert crc16_xmodem(data) == bits
