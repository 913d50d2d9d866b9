# SPDX-License-Identifier: MIT
"""The line between the frames of two controllers and the UART of one; packets as VESC publishes them."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.vesc.condition import FAULT, FLAGS, ask
from segway_ecc.firmware_io.drives.vesc.frames import (
    Current,
    DelayedCurrent,
    Duty,
    PacketId,
    RelativeCurrent,
    ask_selective,
    encode_values,
    frame_of,
    mask_of,
)
from segway_ecc.firmware_io.drives.vesc.packets import frame_packet
from segway_ecc.firmware_io.drives.vesc.serial_codec import VescSerialCodec
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings, VescWheelSettings
from segway_ecc.firmware_io.integrity import Refusal
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.serial_link import SerialCodec
from tests.fuzzing import fuzzed

NEAR, FAR = 5, 23
QUESTION = "3200 22A1C4"  # motor current, duty, erpm, supply, tachometer, fault, identifier, flags
VALUES = {
    "motor_current": -12.34,
    "duty": 0.25,
    "erpm": 7000,
    "bus_voltage": 36.5,
    "tachometer": -42,
    "fault": 5,
    "controller_id": NEAR,
    "flags": 1,
}
REPLY_DATA = "FFFFFB2E" + "00FA" + "00001B58" + "016D" + "FFFFFFD6" + "05"
STATUS = bytes.fromhex("00001B58FF8500FA")
STATUS_5 = bytes.fromhex("FFFFFFD6016D0000")


def wheel(controller_id: int) -> VescWheelSettings:
    return VescWheelSettings(controller_id=controller_id, pole_pairs=7, torque_constant=0.1, max_torque=3.0)


SETTINGS = VescSettings(axes={"left": wheel(NEAR), "right": wheel(FAR)}, timeout_set_s=0.05)


@pytest.fixture
def line() -> VescSerialCodec:
    return VescSerialCodec(SETTINGS)


def framed(text: str) -> bytes:
    return frame_packet(bytes.fromhex(text))


def reply(controller_id: int = NEAR, flags: str = "01") -> bytes:
    return framed(QUESTION + REPLY_DATA + f"{controller_id:02X}" + flags)


REPLIES = {controller_id: reply(controller_id) for controller_id in (NEAR, FAR, 6)}


def extended(identifier: int, data: bytes | str, received_ns: int = 0) -> Frame:
    return Frame(identifier, bytes.fromhex(data) if isinstance(data, str) else data, received_ns, is_extended=True)


def test_implements_serial_codec(line: VescSerialCodec) -> None:
    used: SerialCodec = line
    assert used.refused == {}


def test_a_command_for_the_controller_at_the_uart_goes_to_it(line: VescSerialCodec) -> None:
    assert line.encode(frame_of(PacketId.SET_CURRENT, NEAR, Current(51.0))) == bytes.fromhex("0205060000C738F51D03")


def test_a_command_for_the_other_one_is_handed_on(line: VescSerialCodec) -> None:
    assert line.encode(frame_of(PacketId.SET_CURRENT, FAR, Current(1.0))) == bytes.fromhex("0207221706000003E8382003")


def test_the_uart_may_be_that_of_the_right_controller() -> None:
    axes = {"left": wheel(5), "right": wheel(23)}
    line = VescSerialCodec(VescSettings(axes=axes, timeout_set_s=0.05, serial_controller="right"))
    assert line.encode(frame_of(PacketId.SET_CURRENT, 5, Current(1.0))) == framed("220506000003E8")
    assert line.encode(frame_of(PacketId.SET_CURRENT, 23, Current(1.0))) == framed("06000003E8")


def test_three_controllers_are_reached_through_the_uart_of_one() -> None:
    axes = {"base": wheel(5), "elbow": wheel(23), "wrist": wheel(40)}
    line = VescSerialCodec(VescSettings(axes=axes, timeout_set_s=0.05, serial_controller="elbow"))
    asked = framed(QUESTION), framed("2205" + QUESTION), framed("2228" + QUESTION)
    assert line.request() == b"".join(asked)
    frames = line.decode(reply(40), 0)
    assert frames[-1].arbitration_id % 256 == 252, "the answer to what this computer asks about the third"
    assert line.encode(frame_of(PacketId.SET_CURRENT, 40, Current(1.0))) == framed("222806000003E8")


@pytest.mark.parametrize(
    ("frame", "packet"),
    [
        (frame_of(PacketId.SET_DUTY, NEAR, Duty(-0.5)), "05FFFF3CB0"),
        (frame_of(PacketId.SET_CURRENT_BRAKE, NEAR, Current(1.0)), "07000003E8"),
        (frame_of(PacketId.SET_CURRENT_HANDBRAKE, NEAR, Current(2.0)), "0A000007D0"),
        (frame_of(PacketId.SET_CURRENT_REL, NEAR, RelativeCurrent(1.0)), "54000186A0"),
        (ask(254, NEAR, FAULT), QUESTION),
        (ask(253, FAR, FLAGS), "2217" + QUESTION),
    ],
)
def test_other_commands_and_requests_are_carried(line: VescSerialCodec, frame: Frame, packet: str) -> None:
    assert line.encode(frame) == framed(packet)


@pytest.mark.parametrize(
    "frame",
    [
        frame_of(PacketId.SET_CURRENT, 255, Current(1.0)),
        frame_of(PacketId.SET_CURRENT, 6, Current(1.0)),
        frame_of(PacketId.SET_CURRENT, NEAR, DelayedCurrent(1.0, 0.1)),
        frame_of(PacketId.SET_CURRENT_BRAKE_REL, NEAR, RelativeCurrent(1.0)),
        Frame(0x117, bytes(4)),
        extended(0x10105, bytes(4)),
    ],
)
def test_nothing_else_is_carried(line: VescSerialCodec, frame: Frame) -> None:
    assert line.encode(frame) is None


def test_both_are_asked(line: VescSerialCodec) -> None:
    assert line.request() == framed(QUESTION) + framed("2217" + QUESTION)


def test_a_reply_becomes_frames_of_that_controller(line: VescSerialCodec) -> None:
    assert line.decode(reply(), 77) == [
        extended(0x905, STATUS, 77),
        extended(0x1B05, STATUS_5, 77),
        extended(0x8FE, "0501320000800005", 77),
        extended(0x8FE, "0501320020000001", 77),
    ]
    frames = line.decode(reply(FAR), 78)
    assert [frame.arbitration_id for frame in frames] == [0x917, 0x1B17, 0x8FD, 0x8FD]
    assert frames[2].data[0] == FAR


def test_older_firmware_sends_no_flags(line: VescSerialCodec) -> None:
    frames = line.decode(reply(flags=""), 77)
    assert [frame.arbitration_id for frame in frames] == [0x905, 0x1B05, 0x8FE]


@pytest.mark.parametrize(
    ("packet", "refusal"),
    [
        ("3200 22A1C4" + REPLY_DATA + "06" + "01", Refusal.UNKNOWN),  # a controller that is not ours
        ("3200 22A1C4" + REPLY_DATA, Refusal.UNKNOWN),  # not said which controller
        ("3200008000 05", Refusal.UNKNOWN),  # another question
        ("04", Refusal.UNKNOWN),
        ("00 0605", Refusal.UNKNOWN),
        ("3200 22A1C4" + REPLY_DATA + "05" + "01" + "00", Refusal.LENGTH),
        ("3200 22A1C4" + "00050000" + REPLY_DATA[8:] + "05" + "01", Refusal.RANGE),  # 3276.80 A
    ],
)
def test_other_packets_are_counted_and_give_no_frame(line: VescSerialCodec, packet: str, refusal: Refusal) -> None:
    assert line.decode(framed(packet), 1) == []
    assert line.refused == {refusal: 1}


def test_a_half_reply_is_forgotten_on_reset(line: VescSerialCodec) -> None:
    whole = reply()
    assert line.decode(whole[:10], 1) == []
    line.reset()
    assert line.decode(whole[10:], 1) == []
    assert len(line.decode(whole, 1)) == 4


def test_every_single_bit_flip_gives_no_frame(line: VescSerialCodec) -> None:
    whole = reply()
    for bit in range(8 * len(whole)):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        assert line.decode(bytes(flipped), 1) == []
        line.reset()


def test_the_bytes_are_those_of_the_reply_codec() -> None:
    assert bytes.fromhex(QUESTION) == ask_selective(mask_of(tuple(VALUES)))
    assert frame_packet(encode_values(bytes.fromhex(QUESTION), VALUES)) == reply()


@fuzzed
@given(st.integers(0, 2**64))
def test_decoding_arbitrary_bytes_never_raises(seed: int) -> None:
    chance = random.Random(seed)  # noqa: S311 - a test's chance, not a secret
    ids = chance.choices((NEAR, FAR, 6), k=chance.randint(0, 3))
    noise = [chance.randbytes(chance.randint(0, 12)) for _ in ids]
    stream = b"".join(part + REPLIES[controller_id] for part, controller_id in zip(noise, ids, strict=True))
    size = chance.randint(1, 30)

    line = VescSerialCodec(SETTINGS)
    frames = [f for start in range(0, len(stream), size) for f in line.decode(stream[start : start + size], 3)]

    told = [frame for frame in frames if frame.arbitration_id >> 8 == PacketId.STATUS]
    assert [frame.arbitration_id & 0xFF for frame in told] == [i for i in ids if i != 6]
    assert {frame.data for frame in told} <= {STATUS}


@pytest.mark.parametrize("length", range(9))
def test_unlisted_frames_are_not_carried(line: VescSerialCodec, length: int) -> None:
    listed = {c << 8 | i for c in (0, 1, 2, 3, 4, 8, 10, 12) for i in (NEAR, FAR)}
    for identifier in range(0x4000):
        assert line.encode(Frame(identifier, bytes(length))) is None
        words = line.encode(extended(identifier, bytes(length)))
        has_words = identifier in listed and (length == 4 or identifier >> 8 == 8)
        assert (words is not None) == has_words
