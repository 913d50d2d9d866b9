# SPDX-License-Identifier: MIT
"""Frames against bytes written by hand from docs/protocol/can.md and registers.md of moteus."""

import math
import random

import pytest

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.drives.moteus import frames as moteus
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import FD_LENGTHS, Frame

QUERY = "1100 1f01 1d0d 120e 1527"
ANSWER = "21000a 2f01 0000803f 000000c0 0000003e 2d0d 00001042 220e 1f00 25272800 50"
"""Position mode, 1 turn, -2 turns/s, 0.125 N m; 36 V; 31 degrees and no fault; 40 ms."""


def answer(text: str = ANSWER, *, is_fd: bool = True) -> Frame:
    return Frame(0x100, bytes.fromhex(text), is_fd=is_fd)


@pytest.mark.parametrize(
    ("source", "destination", "wants_reply", "key"),
    [
        (0, 1, True, FrameKey(0x8001, is_extended=True)),
        (0, 1, False, FrameKey(0x0001, is_extended=False)),
        (1, 0, False, FrameKey(0x0100, is_extended=False)),
        (7, 0, False, FrameKey(0x0700, is_extended=False)),
        (8, 0, False, FrameKey(0x0800, is_extended=True)),
        (126, 5, True, FrameKey(0xFE05, is_extended=True)),
    ],
)
def test_a_frame_has_source_and_destination_in_its_identifier(
    source: int,
    destination: int,
    wants_reply: bool,  # noqa: FBT001
    key: FrameKey,
) -> None:
    assert moteus.route(source, destination, wants_reply=wants_reply) == key


def test_a_torque_is_position_mode_without_position_and_gains() -> None:
    wanted = "01000a 0c0620 0000c07f 00000000 0000003f 00000000 00000000 00004040 0d27 0ad7233d" + QUERY
    assert moteus.torque_command(0.5, 3.0, 0.04) == bytes.fromhex(wanted)


def test_a_stop_carries_the_time_out_and_the_query() -> None:
    assert moteus.stop_command(0.04) == bytes.fromhex("010000 0d27 0ad7233d" + QUERY)


def test_a_torque_of_zero_is_known_whatever_its_sign() -> None:
    assert moteus.is_zero(moteus.torque_command(-0.0, 3.0, 0.04))
    assert moteus.is_zero(moteus.torque_command(0.0, 1.0, 0.02))
    assert not moteus.is_zero(moteus.torque_command(1e-6, 3.0, 0.04))
    assert not moteus.is_zero(moteus.stop_command(0.04))


@pytest.mark.parametrize("size", [0, 7, 11, 46, 64])
def test_a_frame_is_filled_up_with_what_means_nothing(size: int) -> None:
    frame = moteus.frame_to(FrameKey(0x8001, is_extended=True), bytes(size))
    assert (frame.arbitration_id, frame.is_extended, frame.is_fd) == (0x8001, True, True)
    assert len(frame.data) in FD_LENGTHS
    assert frame.data == bytes(size) + b"\x50" * (len(frame.data) - size)


def test_an_answer_is_read_in_si() -> None:
    assert moteus.decode_reply(answer()) == pytest.approx((10, 1.0, -2.0, 0.125, 36.0, 31, 0, 0.04))


@pytest.mark.parametrize(
    ("frame", "refusal"),
    [
        (answer(is_fd=False), Refusal.LENGTH),
        (answer(ANSWER[:-2]), Refusal.LENGTH),
        (answer(ANSWER + "50"), Refusal.LENGTH),
        (answer(ANSWER.replace("2100", "2500")), Refusal.UNKNOWN),
        (answer(ANSWER.replace("2f01", "2f02")), Refusal.UNKNOWN),
        (answer(ANSWER.replace("2d0d", "2d0e")), Refusal.UNKNOWN),
        (answer(ANSWER.replace("220e", "210e")), Refusal.UNKNOWN),
        (answer(ANSWER.replace("2527", "2528")), Refusal.UNKNOWN),
        (answer(ANSWER[:-2] + "00"), Refusal.UNKNOWN),
        (answer(ANSWER.replace("21000a", "210010")), Refusal.RANGE),
        (answer(ANSWER.replace("21000a", "2100ff")), Refusal.RANGE),
        (answer(ANSWER.replace("0000803f", "0000c07f")), Refusal.RANGE),
        (answer(ANSWER.replace("000000c0", "0000807f")), Refusal.RANGE),
        (answer(ANSWER.replace("0000003e", "0000c07f")), Refusal.RANGE),
        (answer(ANSWER.replace("00001042", "0000c07f")), Refusal.RANGE),
    ],
)
def test_any_other_answer_is_refused(frame: Frame, refusal: Refusal) -> None:
    with pytest.raises(FrameRefusedError) as caught:
        moteus.decode_reply(frame)
    assert caught.value.refusal is refusal


def test_noise_is_refused_and_nothing_else_is_raised() -> None:
    chance = random.Random(1)  # noqa: S311 - noise, and the same every time
    for _ in range(2_000):
        frame = Frame(0x100, chance.randbytes(chance.choice(FD_LENGTHS)), is_fd=True)
        for decode in (moteus.decode_reply, moteus.decode_text):
            with pytest.raises(FrameRefusedError):
                decode(frame)


def test_faults_are_named_by_their_numbers() -> None:
    assert moteus.fault_name(32) == "calibration (fault 32)"
    assert moteus.fault_name(34) == "over-voltage (fault 34)"
    assert moteus.fault_name(39) == "outside servopos limits (fault 39)"
    assert moteus.fault_name(40) == "under-voltage (fault 40)"
    assert moteus.fault_name(48) == "servopos limits invalid (fault 48)"
    assert [moteus.fault_name(code) for code in (0, 31, 49)] == ["fault 0", "fault 31", "fault 49"]


def test_modes_are_named_by_their_numbers() -> None:
    assert (moteus.MODES[0], moteus.MODES[10], moteus.MODES[11], moteus.MODES[15], len(moteus.MODES)) == (
        *("stopped", "position", "timeout", "brake"),
        16,
    )
    assert sorted(moteus.OFF) == [0, 1, 2, 3, 4, 11]


def test_a_line_for_the_console_and_its_answer() -> None:
    assert moteus.console_line("conf get a.b") == b"\x40\x01\x0dconf get a.b\n"
    assert bytes((0x42, 1, 48)) == moteus.POLL_TEXT
    text = Frame(0x17E, b"\x41\x01\x02ok\x50\x50\x50", is_fd=True)
    assert moteus.decode_text(text) == b"ok"
    assert moteus.decode_text(Frame(0x17E, b"\x41\x01\x00", is_fd=True)) == b""


@pytest.mark.parametrize(
    ("data", "is_fd"),
    [(b"\x41\x01\x02o", True), (b"\x41\x02\x00", True), (b"\x41\x01", True), (b"", True), (b"\x41\x01\x00", False)],
)
def test_what_is_no_text_of_the_console_is_refused(data: bytes, is_fd: bool) -> None:  # noqa: FBT001
    with pytest.raises(FrameRefusedError):
        moteus.decode_text(Frame(0x17E, data, is_fd=is_fd))


def test_before_the_first_answer_nothing_is_known() -> None:
    assert moteus.NOTHING.mode == moteus.STOPPED
    assert not any(map(math.isnan, moteus.NOTHING))
