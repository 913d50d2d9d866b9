# SPDX-License-Identifier: MIT
"""The serial packets; expected bytes are those of VESC's protocol, the values worked out by hand."""

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.vesc.frames import (
    ALL_FIELDS,
    FIELD_NAMES,
    SET_PACKETS,
    Comm,
    ask_selective,
    decode_values,
    encode_values,
    forward,
    mask_of,
    read_mask,
)
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from tests.fuzzing import fuzzed

SIZES = [2, 2, 4, 4, 4, 4, 2, 4, 2, 4, 4, 4, 4, 4, 4, 1, 4, 1, 6, 4, 4, 1]
"""Bytes of each bit's field."""
REPLY = {
    "fet_celsius": ("00FF", 25.5),
    "motor_celsius": ("FF9C", -10.0),
    "motor_current": ("00000834", 21.0),
    "input_current": ("FFFFFF9C", -1.0),
    "d_current": ("00000001", 0.01),
    "q_current": ("000007D0", 20.0),
    "duty": ("FF06", -0.25),
    "erpm": ("00001B58", 7000),
    "bus_voltage": ("016D", 36.5),
    "amp_hours": ("00003A98", 1.5),
    "amp_hours_charged": ("000009C4", 0.25),
    "watt_hours": ("00004E20", 2.0),
    "watt_hours_charged": ("00001388", 0.5),
    "tachometer": ("FFFFFFD6", -42),
    "tachometer_absolute": ("0000002A", 42),
    "fault": ("05", 5),
    "degrees": ("055D4A80", 90.0),
    "controller_id": ("17", 23),
    "mos_1_celsius": ("00C8", 20.0),
    "mos_2_celsius": ("00D2", 21.0),
    "mos_3_celsius": ("00DC", 22.0),
    "d_voltage": ("000003E8", 1.0),
    "q_voltage": ("FFFFFC18", -1.0),
    "flags": ("01", 1),
}
WHOLE = bytes.fromhex("04" + "".join(data for data, _ in REPLY.values()))
VALUES = {name: value for name, (_, value) in REPLY.items()}


def test_numbers_are_the_protocols() -> None:
    assert {comm.name: int(comm) for comm in Comm} == {
        "FW_VERSION": 0,
        "GET_VALUES": 4,
        "SET_DUTY": 5,
        "SET_CURRENT": 6,
        "SET_CURRENT_BRAKE": 7,
        "SET_RPM": 8,
        "SET_POS": 9,
        "SET_HANDBRAKE": 10,
        "GET_MCCONF": 14,
        "ALIVE": 30,
        "FORWARD_CAN": 34,
        "GET_VALUES_SELECTIVE": 50,
        "SET_CURRENT_REL": 84,
    }
    assert {command.name: packet.name for command, packet in SET_PACKETS.items()} == {
        **{name: name for name in ("SET_DUTY", "SET_CURRENT", "SET_CURRENT_BRAKE", "SET_RPM", "SET_POS")},
        "SET_CURRENT_HANDBRAKE": "SET_HANDBRAKE",
        "SET_CURRENT_REL": "SET_CURRENT_REL",
    }


def test_a_question_is_the_published_one() -> None:
    mask = mask_of(("q_current", "erpm", "bus_voltage", "tachometer"))
    assert ask_selective(mask).hex() == "32000021a0"


@pytest.mark.parametrize(
    ("name", "bit"),
    [("fet_celsius", 0), ("erpm", 7), ("bus_voltage", 8), ("tachometer", 13), ("fault", 15), ("controller_id", 17)],
)
def test_each_value_has_its_bit(name: str, bit: int) -> None:
    assert mask_of((name,)) == 1 << bit


def test_values_that_share_a_bit_come_together() -> None:
    assert mask_of(("mos_1_celsius", "mos_3_celsius", "flags")) == 1 << 18 | 1 << 21
    assert mask_of(FIELD_NAMES) == ALL_FIELDS == (1 << len(SIZES)) - 1


def test_a_packet_is_forwarded_behind_the_identifier_of_the_receiver() -> None:
    assert forward(23, bytes.fromhex("06000003E8")).hex().upper() == "221706000003E8"


def test_a_whole_reply_has_every_value() -> None:
    assert tuple(REPLY) == FIELD_NAMES
    mask, values = decode_values(WHOLE)
    assert mask == ALL_FIELDS
    assert values == pytest.approx(VALUES)
    assert encode_values(b"\x04", VALUES) == WHOLE


@pytest.mark.parametrize("bit", range(22))
def test_a_selected_value_is_found_whatever_stands_before_it(bit: int) -> None:
    start = 1 + sum(SIZES[:bit])
    reply = ask_selective(1 << bit) + WHOLE[start : start + SIZES[bit]]
    mask, values = decode_values(reply)
    assert mask == 1 << bit
    assert values == pytest.approx({name: VALUES[name] for name in values})
    assert mask_of(list(values)) == 1 << bit
    assert encode_values(ask_selective(1 << bit), VALUES) == reply


def test_older_firmware_ends_its_reply_before_what_it_does_not_know() -> None:
    _, values = decode_values(WHOLE[:-1])
    assert "flags" not in values
    assert values["q_voltage"] == -1.0
    _, nothing = decode_values(ask_selective(mask_of(("flags",))))
    assert nothing == {}


def test_a_reply_that_ends_within_a_value_is_refused() -> None:
    ends = {1}
    for size in SIZES:
        ends.add(max(ends) + size)
    for length in range(1, len(WHOLE)):
        if length in ends:
            decode_values(WHOLE[:length])
            continue
        with pytest.raises(FrameRefusedError) as refused:
            decode_values(WHOLE[:length])
        assert refused.value.refusal is Refusal.LENGTH


def test_newer_firmware_may_add_to_all_values_but_not_to_selected_ones() -> None:
    assert decode_values(WHOLE + b"\x07")[1] == pytest.approx(VALUES)
    with pytest.raises(FrameRefusedError) as refused:
        decode_values(ask_selective(1) + b"\0\0\0")
    assert refused.value.refusal is Refusal.LENGTH


@pytest.mark.parametrize(
    ("packet", "refusal"),
    [
        ("", Refusal.UNKNOWN),
        ("05", Refusal.UNKNOWN),
        ("0400", Refusal.UNKNOWN),
        ("32", Refusal.LENGTH),
        ("32000000", Refusal.LENGTH),
        ("3200400000", Refusal.UNKNOWN),
    ],
)
def test_what_is_no_question_is_refused(packet: str, refusal: Refusal) -> None:
    with pytest.raises(FrameRefusedError) as refused:
        read_mask(bytes.fromhex(packet))
    assert refused.value.refusal is refusal


@pytest.mark.parametrize("value", [3276.8, -3276.9, math.nan, math.inf])
def test_a_value_that_does_not_fit_is_refused(value: float) -> None:
    with pytest.raises(FrameRefusedError) as refused:
        encode_values(ask_selective(1), {"fet_celsius": value})
    assert refused.value.refusal is Refusal.RANGE


@fuzzed
@given(st.binary(max_size=90))
def test_decoding_gives_finite_values_that_encode_to_the_same_bytes_or_refuses(data: bytes) -> None:
    mask = int.from_bytes(data[:3], "big") & ALL_FIELDS
    length = sum(size for bit, size in enumerate(SIZES) if mask >> bit & 1)
    for packet in (data, b"\x04" + data, ask_selective(mask) + data[3 : 3 + length]):
        with contextlib.suppress(FrameRefusedError):
            found, values = decode_values(packet)
            assert 0 <= found <= ALL_FIELDS
            assert all(math.isfinite(value) for value in values.values())
            if mask_of(list(values)) == found and packet[0] == Comm.GET_VALUES_SELECTIVE:
                assert encode_values(packet[:5], values) == packet
