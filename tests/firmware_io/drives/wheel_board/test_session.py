# SPDX-License-Identifier: MIT
"""Commands of version 2: what is sent, what is taken, and what neither chance nor a recording gets past."""

import binascii
import random
import struct
from importlib.resources import as_file, files
from typing import Any

import cantools
import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.wheel_board.frames import BoardSetup, FrameId, WheelCommand, encode
from segway_ecc.firmware_io.drives.wheel_board.session import (
    WINDOW,
    CommandId,
    CommandReceiver,
    CommandSession,
    code_of,
    voltage_of,
)
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame

ON = WheelCommand(12.345, -6.789, enable=True)
OFF = WheelCommand(0.0, 0.0, enable=False)
SETUP = BoardSetup(0.04)
NUMBER = 0xFEDCBA98

with as_file(files("segway_ecc.firmware_io.drives.wheel_board") / "wheel_board.dbc") as _path:
    DBC: Any = cantools.database.load_file(_path)


class Ends:
    """A host and a board in one session."""

    def __init__(self, counter: int = 0) -> None:
        self.host, self.board = CommandSession(), CommandSession()
        for end in (self.host, self.board):
            end.begin(NUMBER)
            end.counter = counter
        self.receiver = CommandReceiver(self.board)

    def take(self, *frames: Frame) -> list[WheelCommand | BoardSetup]:
        """What the board takes of some frames."""
        return [taken for frame in frames if (taken := self.receiver.check(frame)) is not None]


@pytest.fixture
def ends() -> Ends:
    return Ends()


def _sealed(identifier: int, body: bytes, counter: int, number: int = NUMBER) -> Frame:
    return Frame(identifier, body + struct.pack("<I", code_of(number, counter, identifier, body)))


def test_frames_are_the_dbcs(ends: Ends) -> None:
    ends.host.counter = 0x1FFFE
    left, right = ends.host.command(ON)
    setup = ends.host.setup(SETUP)
    expected = [
        ("LEFT_COMMAND", left, {"Voltage": 12.345, "Counter": 0x7FFF, "Enable": 1}),
        ("RIGHT_COMMAND", right, {"Voltage": -6.789, "Counter": 0x7FFF, "Enable": 1}),
        ("SESSION_SETUP", setup, {"Watchdog": 0.04, "Counter": 0}),
    ]
    for name, frame, values in expected:
        message = DBC.get_message_by_name(name)
        assert frame.arbitration_id == message.frame_id == CommandId[name]
        decoded = message.decode(frame.data)
        assert {key: decoded[key] for key in values} == pytest.approx(values)
        assert not frame.is_extended


def test_code_is_crc_32_over_session_counter_identifier_and_body() -> None:
    whole = bytes.fromhex("98badcfe040302011301aabbccdd")
    assert code_of(NUMBER, 0x01020304, 0x113, bytes.fromhex("aabbccdd")) == binascii.crc32(whole)
    assert binascii.crc32(b"123456789") == 0xCBF43926


def test_who_looks_on_reads_the_voltage_of_a_command(ends: Ends) -> None:
    assert [voltage_of(frame.data) for frame in ends.host.command(ON)] == pytest.approx([12.345, -6.789])


def test_command_is_taken_with_its_second_half(ends: Ends) -> None:
    left, right = ends.host.command(ON)
    assert ends.receiver.check(left) is None
    assert ends.receiver.check(right) == ON
    assert ends.take(*ends.host.command(OFF)) == [OFF]
    assert ends.receiver.refused == {}
    assert (ends.board.counter, ends.board.epoch) == (2, 0)


def test_setup_is_taken_and_leaves_the_counter_to_the_commands(ends: Ends) -> None:
    frame = ends.host.setup(SETUP)
    assert ends.take(frame) == [SETUP]
    assert ends.board.counter == 0
    assert ends.take(*ends.host.command(ON), frame) == [ON]
    assert ends.receiver.refused == {Refusal.COUNTER: 1}


@pytest.mark.parametrize(
    "payload", [WheelCommand(30.001, 0.0, enable=True), WheelCommand(0.0, float("nan"), enable=True)]
)
def test_voltage_out_of_range_is_never_sent(ends: Ends, payload: WheelCommand) -> None:
    with pytest.raises(FrameRefusedError, match="range"):
        ends.host.command(payload)
    assert ends.host.counter == 0


def test_time_out_of_range_is_never_sent(ends: Ends) -> None:
    with pytest.raises(FrameRefusedError, match="range"):
        ends.host.setup(BoardSetup(1.1))


@pytest.mark.parametrize(
    ("identifier", "body"),
    [(CommandId.LEFT_COMMAND, b"\x00\x80\x01\x80"), (CommandId.SESSION_SETUP, b"\x01\x00\x01\x00")],
)
def test_value_out_of_range_is_refused(ends: Ends, identifier: int, body: bytes) -> None:
    assert ends.take(_sealed(identifier, body, 1)) == []
    assert ends.receiver.refused == {Refusal.RANGE: 1}


def test_every_flipped_bit_is_refused(ends: Ends) -> None:
    frames = [ends.host.setup(SETUP), *ends.host.command(ON)]
    for frame in frames:
        whole = int.from_bytes(frame.data, "big")
        for bit in range(64):
            assert ends.take(replace(frame, data=(whole ^ 1 << bit).to_bytes(8, "big"))) == []
    assert ends.receiver.refused.total() == 3 * 64
    assert ends.take(*frames) == [SETUP, ON]


def test_halves_of_different_commands_make_none(ends: Ends) -> None:
    (left, _), (_, right), (last, final) = ends.host.command(ON), ends.host.command(OFF), ends.host.command(ON)
    assert ends.take(right, left, right) == []
    assert ends.receiver.refused == {Refusal.COUNTER: 2}
    assert ends.take(last, final) == [ON], "what was refused leaves the counter where it was"


def test_halves_that_disagree_whether_to_enable_make_none(ends: Ends) -> None:
    left = _sealed(CommandId.LEFT_COMMAND, b"\0\0\x01\x80", 1)
    right = _sealed(CommandId.RIGHT_COMMAND, b"\0\0\x01\x00", 1)
    assert ends.take(left, right) == []
    assert ends.receiver.refused == {Refusal.COUNTER: 1}


def test_half_of_the_next_command_that_never_ends_does_not_stop_the_others(ends: Ends) -> None:
    ahead = Ends(WINDOW - 1).host.command(ON)[0]
    assert ends.take(ahead, *ends.host.command(ON), *ends.host.command(ON)) == [ON, ON]


def test_two_commands_whose_halves_the_bus_sorted_are_both_taken(ends: Ends) -> None:
    (left, right), (next_left, next_right) = ends.host.command(OFF), ends.host.command(ON)
    assert ends.take(left, next_left, right, next_right) == [OFF, ON]


def test_halves_that_wait_are_few_and_the_oldest_goes(ends: Ends) -> None:
    commands = [ends.host.command(ON) for _ in range(5)]
    assert ends.take(*(left for left, _ in commands), commands[0][1]) == []
    assert ends.take(commands[1][1]) == [ON]
    assert ends.receiver.refused == {Refusal.COUNTER: 1}


def test_each_line_joins_its_own_halves_and_a_count_counts_on_both(ends: Ends) -> None:
    other = CommandReceiver(ends.board)
    left, right = ends.host.command(ON)
    assert [ends.receiver.check(left), other.check(right)] == [None, None]
    assert ends.receiver.check(right) == ON
    assert [other.check(left), other.check(right)] == [None, None]
    assert other.refused == {Refusal.COUNTER: 3}


def test_what_was_lost_is_passed_over_within_the_window(ends: Ends) -> None:
    ends.host.counter = WINDOW - 1
    assert ends.take(*ends.host.command(ON)) == [ON]
    ends.host.counter += WINDOW
    assert ends.take(*ends.host.command(ON)) == []
    assert ends.receiver.refused == {Refusal.COUNTER: 2}


@pytest.mark.parametrize("counter", [0x7FFE, 0xFFFFFFFE, 0x3FFF_FFFF])
def test_counter_goes_on_where_its_bits_wrap(counter: int) -> None:
    ends = Ends(counter)
    for _ in range(4):
        assert ends.take(*ends.host.command(ON)) == [ON]
    assert ends.receiver.refused == {}


def test_recording_of_the_same_bits_of_the_counter_is_refused(ends: Ends) -> None:
    recorded = ends.host.command(ON)
    for epoch in (1, 2, 0xFFFF, 0x10000):
        later = Ends(epoch << 15)
        assert later.take(*recorded) == []
        assert later.receiver.refused == {Refusal.CRC: 2}


def test_recording_of_another_session_is_refused(ends: Ends) -> None:
    recorded = [ends.host.setup(SETUP), *ends.host.command(ON)]
    ends.board.begin(NUMBER + 1)
    assert ends.take(*recorded) == []
    assert ends.receiver.refused == {Refusal.CRC: 3}


def test_before_a_session_everything_is_refused() -> None:
    receiver = CommandReceiver(CommandSession())
    assert receiver.check(_sealed(CommandId.LEFT_COMMAND, b"\0\0\x01\0", 1, 0)) is None
    assert receiver.refused == {Refusal.COUNTER: 1}


def test_other_lengths_and_version_1_are_refused_and_what_is_somebody_elses_is_not_counted(ends: Ends) -> None:
    old = Frame(FrameId.WHEEL_COMMAND, encode(FrameId.WHEEL_COMMAND, ON, 0))
    assert ends.take(*(Frame(CommandId.LEFT_COMMAND, bytes(n)) for n in (*range(8), 9)), old) == []
    assert ends.receiver.refused == {Refusal.LENGTH: 9, Refusal.UNKNOWN: 1}
    left, right = ends.host.command(ON)
    foreign = [replace(left, is_extended=True), replace(left, is_remote=True), Frame(0x115, right.data), Frame(0, b"")]
    assert ends.take(*foreign) == []
    assert ends.receiver.refused.total() == 10


def test_who_joins_late_follows_with_the_announced_bits() -> None:
    ends, guard = Ends(0x5_4321), CommandSession()
    guard.begin(NUMBER, ends.host.epoch)
    receiver = CommandReceiver(guard, window=0x7FFF)
    assert [receiver.check(frame) for frame in ends.host.command(ON)] == [None, ON]
    assert guard.counter == ends.host.counter


def test_no_random_frame_is_taken(ends: Ends) -> None:
    dice = random.Random(21)  # noqa: S311 - the same frames every time are wanted
    for _ in range(50_000):
        assert ends.receiver.check(Frame(dice.choice([*CommandId]), dice.randbytes(8))) is None
    assert ends.receiver.refused.total() == 50_000
    assert ends.receiver.refused[Refusal.CRC] > 0
