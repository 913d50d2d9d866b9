# SPDX-License-Identifier: MIT
"""The reference is a DBC, read by cantools, with layouts and factors as section 6 of MT1604P prints them."""

import math
import struct
from typing import Any, cast

import cantools
import pytest
from cantools.database.can import Database
from hypothesis import example, given
from hypothesis import strategies as st

from segway_ecc.firmware_io.imus.xsens_mti.frames import DEFAULT_IDS, LAYOUTS, Message, decode, encode
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from tests.fuzzing import fuzzed

DBC = """
BO_ 1 error: 1 MTi
 SG_ a : 7|8@0+ (1,0) [0|255] "" Host
BO_ 2 warning: 1 MTi
 SG_ a : 7|8@0+ (1,0) [0|255] "" Host
BO_ 5 sample_time: 4 MTi
 SG_ a : 7|32@0+ (1,0) [0|4294967295] "" Host
BO_ 6 group_counter: 2 MTi
 SG_ a : 7|16@0+ (1,0) [0|65535] "" Host
BO_ 7 utc_time: 8 MTi
 SG_ a : 7|8@0+ (1,0) [0|255] "" Host
 SG_ b : 15|8@0+ (1,0) [1|12] "" Host
 SG_ c : 23|8@0+ (1,0) [1|31] "" Host
 SG_ d : 31|8@0+ (1,0) [0|23] "" Host
 SG_ e : 39|8@0+ (1,0) [0|59] "" Host
 SG_ f : 47|8@0+ (1,0) [0|60] "" Host
 SG_ g : 55|16@0+ (0.0001,0) [0|0.9999] "" Host
BO_ 17 status_word: 4 MTi
 SG_ a : 7|32@0+ (1,0) [0|4294967295] "" Host
BO_ 33 quaternion: 8 MTi
 SG_ a : 7|16@0- (0.000030518509475997,0) [-1|1] "" Host
 SG_ b : 23|16@0- (0.000030518509475997,0) [-1|1] "" Host
 SG_ c : 39|16@0- (0.000030518509475997,0) [-1|1] "" Host
 SG_ d : 55|16@0- (0.000030518509475997,0) [-1|1] "" Host
BO_ 34 euler_angles: 6 MTi
 SG_ a : 7|16@0- (0.0078125,0) [-180|180] "deg" Host
 SG_ b : 23|16@0- (0.0078125,0) [-90|90] "deg" Host
 SG_ c : 39|16@0- (0.0078125,0) [-180|180] "deg" Host
BO_ 50 rate_of_turn: 6 MTi
 SG_ a : 7|16@0- (0.001953125,0) [-35|35] "rad/s" Host
 SG_ b : 23|16@0- (0.001953125,0) [-35|35] "rad/s" Host
 SG_ c : 39|16@0- (0.001953125,0) [-35|35] "rad/s" Host
BO_ 51 delta_q: 8 MTi
 SG_ a : 7|16@0- (0.000030518509475997,0) [-1|1] "" Host
 SG_ b : 23|16@0- (0.000030518509475997,0) [-1|1] "" Host
 SG_ c : 39|16@0- (0.000030518509475997,0) [-1|1] "" Host
 SG_ d : 55|16@0- (0.000030518509475997,0) [-1|1] "" Host
BO_ 52 acceleration: 6 MTi
 SG_ a : 7|16@0- (0.00390625,0) [-100|100] "m/s2" Host
 SG_ b : 23|16@0- (0.00390625,0) [-100|100] "m/s2" Host
 SG_ c : 39|16@0- (0.00390625,0) [-100|100] "m/s2" Host
BO_ 53 free_acceleration: 6 MTi
 SG_ a : 7|16@0- (0.00390625,0) [-100|100] "m/s2" Host
 SG_ b : 23|16@0- (0.00390625,0) [-100|100] "m/s2" Host
 SG_ c : 39|16@0- (0.00390625,0) [-100|100] "m/s2" Host
BO_ 65 magnetic_field: 6 MTi
 SG_ a : 7|16@0- (0.0009765625,0) [-32|32] "" Host
 SG_ b : 23|16@0- (0.0009765625,0) [-32|32] "" Host
 SG_ c : 39|16@0- (0.0009765625,0) [-32|32] "" Host
BO_ 81 temperature: 2 MTi
 SG_ a : 7|16@0- (0.00390625,0) [-128|128] "degC" Host
BO_ 97 rate_of_turn_hr: 6 MTi
 SG_ a : 7|16@0- (0.001953125,0) [-35|35] "rad/s" Host
 SG_ b : 23|16@0- (0.001953125,0) [-35|35] "rad/s" Host
 SG_ c : 39|16@0- (0.001953125,0) [-35|35] "rad/s" Host
BO_ 98 acceleration_hr: 6 MTi
 SG_ a : 7|16@0- (0.00390625,0) [-100|100] "m/s2" Host
 SG_ b : 23|16@0- (0.00390625,0) [-100|100] "m/s2" Host
 SG_ c : 39|16@0- (0.00390625,0) [-100|100] "m/s2" Host
"""
REFERENCE = cast("Database", cantools.database.load_string("BU_: MTi Host\n" + DBC.replace("\nBO_", "\n\nBO_"), "dbc"))
FIXED = [message for message in Message if message is not Message.DELTA_V]
LENGTHS = {message: REFERENCE.get_message_by_name(message).length for message in LAYOUTS}


def refusal(message: Message, data: bytes) -> Refusal | None:
    try:
        decode(message, data)
    except FrameRefusedError as error:
        return error.refusal
    return None


def test_the_ids_are_those_of_the_document() -> None:
    assert {m.name: m.frame_id for m in REFERENCE.messages} == {m: DEFAULT_IDS[m] for m in FIXED}
    assert DEFAULT_IDS[Message.DELTA_V] == 0x031


VECTORS: list[tuple[Message, str, tuple[float, ...]]] = [
    (Message.ACCELERATION, "0000000009CF", (0.0, 0.0, 9.80859375)),
    (Message.ACCELERATION, "F6310001FF00", (-9.80859375, 0.00390625, -1.0)),
    (Message.RATE_OF_TURN, "0200FE004600", (1.0, -1.0, 35.0)),
    (Message.TEMPERATURE, "1980", (25.5,)),
    (Message.GROUP_COUNTER, "FFFE", (65534,)),
    (Message.SAMPLE_TIME, "01020304", (16909060,)),
    (Message.STATUS_WORD, "80000001", (2147483649,)),
    (Message.ERROR, "01", (1,)),
]


@pytest.mark.parametrize(("message", "data", "values"), VECTORS)
def test_known_messages_decode_to_known_values(message: Message, data: str, values: tuple[float, ...]) -> None:
    assert decode(message, bytes.fromhex(data)) == pytest.approx(values, abs=1e-12)
    assert encode(message, values) == bytes.fromhex(data)


@fuzzed
@given(st.sampled_from(list(LAYOUTS)), st.binary(min_size=8, max_size=8))
def test_every_message_is_read_as_the_reference_reads_it(message: Message, eight: bytes) -> None:
    data = eight[: LENGTHS[message]]
    frame = REFERENCE.get_message_by_name(message)
    expected: Any = frame.decode(data)
    inside = all(
        (s.minimum or 0) - 1e-9 <= expected[s.name] <= (s.maximum or 0) + 1e-9 and s.minimum is not None
        for s in frame.signals
    )
    if not inside:
        assert refusal(message, data) is Refusal.RANGE
        return
    ordered = [expected[s.name] for s in sorted(frame.signals, key=lambda s: s.name)]
    assert decode(message, data) == pytest.approx(ordered, rel=1e-12, abs=1e-12)
    assert encode(message, decode(message, data)) == data


@fuzzed
@given(st.binary(max_size=9))
@example(bytes.fromhex("7FFF7FFF7FFF11"))
@example(bytes.fromhex("8000000000000000"))
def test_whatever_comes_is_finite_or_refused(data: bytes) -> None:
    for message in LAYOUTS:
        cause = refusal(message, data)
        if len(data) != LENGTHS[message]:
            assert cause is Refusal.LENGTH
        elif cause is None:
            assert all(map(math.isfinite, decode(message, data)))
        else:
            assert cause is Refusal.RANGE


def test_a_refusal_names_the_message_and_the_cause() -> None:
    with pytest.raises(FrameRefusedError, match=r"^rate_of_turn of the MTi refused: length$"):
        decode(Message.RATE_OF_TURN, b"")


@pytest.mark.parametrize("message", LAYOUTS)
def test_another_length_is_refused(message: Message) -> None:
    for length in range(65):
        if length != LENGTHS[message]:
            assert refusal(message, bytes(length)) is Refusal.LENGTH


@pytest.mark.parametrize(
    ("message", "last_good", "first_bad"),
    [
        (Message.RATE_OF_TURN, "460000000000", "460100000000"),
        (Message.RATE_OF_TURN, "00000000BA00", "00000000B9FF"),
        (Message.ACCELERATION, "640000000000", "640100000000"),
    ],
)
def test_ranges_end_at_the_documented_limits(message: Message, last_good: str, first_bad: str) -> None:
    assert refusal(message, bytes.fromhex(last_good)) is None
    assert refusal(message, bytes.fromhex(first_bad)) is Refusal.RANGE


@pytest.mark.parametrize(
    ("message", "values", "cause"),
    [
        (Message.ACCELERATION, (0.0, 0.0), Refusal.LENGTH),
        (Message.TEMPERATURE, (), Refusal.LENGTH),
        (Message.ACCELERATION, (0.0, 100.01, 0.0), Refusal.RANGE),
        (Message.RATE_OF_TURN, (math.nan, 0.0, 0.0), Refusal.RANGE),
        (Message.RATE_OF_TURN, (0.0, 0.0, math.inf), Refusal.RANGE),
        (Message.GROUP_COUNTER, (65536,), Refusal.RANGE),
        (Message.ERROR, (-1,), Refusal.RANGE),
    ],
)
def test_what_a_message_cannot_carry_is_refused(message: Message, values: tuple[float, ...], cause: Refusal) -> None:
    with pytest.raises(FrameRefusedError) as caught:
        encode(message, values)
    assert caught.value.refusal is cause


def test_counts_stay_whole_numbers() -> None:
    (ticks,) = decode(Message.SAMPLE_TIME, struct.pack(">I", 0xFFFFFFFF))
    assert isinstance(ticks, int)
    assert ticks == 2**32 - 1
