# SPDX-License-Identifier: MIT
import math
import struct
from collections import Counter
from collections.abc import Callable, Sequence
from functools import reduce
from operator import xor

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.frames import Firmware, Message, encode, request
from segway_ecc.firmware_io.drives.odrive.serial_codec import OdriveSerialCodec, checked
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.serial_link import SerialCodec
from tests.fuzzing import fuzzed

Configure = Callable[..., OdriveSettings]
NOW = 123_456_789
LEFT = Frame(0x009, struct.pack("<ff", 1.5, 0.25), NOW)
RIGHT = Frame(0x029, struct.pack("<ff", -2.5, -0.125), NOW)
BEATS = (Frame(0x001, struct.pack("<IBxxx", 64, 1), NOW), Frame(0x021, struct.pack("<IBxxx", 2048, 3), NOW))
REPLIES = ("1.500000 0.250000", "-2.500000 -0.125000")
STATES = ("1", "64", "3", "2048")
AXIS_SETTINGS = (
    "controller.config.vel_limit",
    "controller.config.enable_overspeed_error",
    "controller.config.enable_torque_mode_vel_limit",
    "config.enable_watchdog",
    "config.watchdog_timeout",
    "motor.config.current_lim",
    "motor.config.torque_lim",
)
TRUE = {LEFT, RIGHT, *BEATS}


def reply(text: str) -> bytes:
    """A line as the board sends it."""
    return f"{text}*{reduce(xor, text.encode(), 0)}\r\n".encode()


def asks_settings(poll: int) -> bool:
    """Whether a poll, counted from 0 on a new line, asks for a setting."""
    return 1 <= poll <= 16 or poll % 10 == 4


def replies(poll: int, texts: Sequence[str] | None = None, settings: Sequence[str] = ("1",)) -> list[bytes]:
    """All lines that answer one poll, counted from 0."""
    told = [*REPLIES, *STATES] if texts is None else texts
    own = settings if asks_settings(poll) else ()
    return [reply(text) for text in (*told, *own, f"invalid motor {10 + poll % 90}")]


class Line(OdriveSerialCodec):
    """The codec without the settings that it reads."""

    def decode(self, data: bytes, now_ns: int) -> list[Frame]:
        return [frame for frame in super().decode(data, now_ns) if frame.arbitration_id % 32 != 0x05]


@pytest.fixture
def line(configure: Configure) -> OdriveSerialCodec:
    return Line(configure())


@pytest.fixture
def started(line: OdriveSerialCodec) -> OdriveSerialCodec:
    """A line whose first poll, the second of which is under way, is answered."""
    line.request()
    assert line.decode(b"".join(replies(0)), NOW) == []
    line.request()
    return line


def test_implements_serial_codec(line: OdriveSerialCodec) -> None:
    fulfilled: SerialCodec = line
    assert not fulfilled.refused


def test_checksums_are_those_of_the_firmwares_documents() -> None:
    assert checked("r vbus_voltage ") == b"r vbus_voltage *93\n"
    assert checked("c 0 0.5") == b"c 0 0.5*120\n"


@pytest.mark.parametrize(
    ("node", "message", "words"),
    [
        (0, m.SetInputTorque(0.5), ["c 0 0.500000"]),
        (1, m.SetInputTorque(-12.25), ["c 1 -12.250000"]),
        (1, m.SetAxisState(8), ["w axis1.requested_state 8"]),
        (0, m.ClearErrors(), ["sc"]),
        (
            1,
            m.SetControllerMode(1, 1),
            ["w axis1.controller.config.control_mode 1", "w axis1.controller.config.input_mode 1"],
        ),
    ],
)
def test_commands_become_lines(line: OdriveSerialCodec, node: int, message: Message, words: list[str]) -> None:
    expected = b"".join(reply(word).replace(b"\r", b"") for word in words)
    assert line.encode(encode(Firmware.V0_5, node, message)) == expected


def test_axes_are_numbered_as_on_the_board(configure: Configure) -> None:
    swapped = Line(
        configure(
            axes={
                "left": {"node_id": 7, "axis": 1, "max_torque": 1.0},
                "right": {"node_id": 9, "axis": 0, "max_torque": 1.0},
            }
        )
    )
    words = swapped.encode(encode(Firmware.V0_5, 7, m.SetAxisState(1)))
    assert words is not None
    assert words.startswith(b"w axis1.requested_state 1*")
    swapped.request()
    swapped.decode(b"".join(replies(0)), NOW)
    swapped.request()
    frames = swapped.decode(b"".join(replies(1)), NOW)
    # Axis 0 is node 9, axis 1 is node 7.
    assert [frame.arbitration_id for frame in frames] == [0x129, 0x0E9, 0x121, 0x0E1]


@pytest.mark.parametrize(
    "frame",
    [
        encode(Firmware.V0_5, 2, m.SetInputTorque(0.0)),
        encode(Firmware.V0_5, 0, m.SetInputVelocity(1.0)),
        request(0, 0x00),
        Frame(0x00E, bytes(8), is_extended=True),
        Frame(0x00E, b"\0\0\xc0\x7f" + bytes(4)),
        Frame(0x007, b""),
    ],
)
def test_nothing_else_is_carried(line: OdriveSerialCodec, frame: Frame) -> None:
    assert line.encode(frame) is None


def test_a_poll_asks_for_everything_of_both_axes_and_ends_with_a_count(line: OdriveSerialCodec) -> None:
    polls = [line.request().decode().splitlines() for _ in range(91)]

    texts = [[words.rpartition("*")[0] for words in poll] for poll in polls]
    asked = ["f 0", "f 1", *(f"r axis{axis}.{name}" for axis in (0, 1) for name in ("current_state", "error"))]
    supply = ["r vbus_voltage", "r ibus"]
    settings = [
        *(f"r axis{axis}.{name}" for name in AXIS_SETTINGS for axis in (0, 1)),
        "r config.dc_max_negative_current",
        "r config.enable_brake_resistor",
    ]
    expected = []
    for index in range(91):
        own = [settings[index - 1 if index <= 16 else index // 10 % 16]] if asks_settings(index) else []
        expected.append([*asked, *supply * (index % 10 == 9), *own])
    assert [poll[:-1] for poll in texts] == expected
    assert [poll[-1] for poll in texts] == [f"f {10 + index % 90}" for index in range(91)]
    assert all(words == reply(words.rpartition("*")[0]).decode().strip() for poll in polls for words in poll)


def test_replies_become_the_frames_of_both_nodes(started: OdriveSerialCodec) -> None:
    assert started.decode(b"".join(replies(1)), NOW) == [LEFT, RIGHT, *BEATS]
    started.request()
    assert started.decode(b"".join(replies(2)), NOW) == [LEFT, RIGHT, *BEATS]
    assert not started.refused


def test_what_was_lost_of_a_poll_costs_that_poll_only(started: OdriveSerialCodec) -> None:
    for poll in range(1, 6):
        lines = replies(poll)
        if poll == 2:
            del lines[0]
        found = started.decode(b"".join(lines), NOW)
        assert (found == []) is (poll == 2)
        started.request()
    assert started.refused == {"lost": 1}


def test_a_lost_count_costs_two_polls(started: OdriveSerialCodec) -> None:
    assert started.decode(b"".join(replies(1)[:-1]), NOW) == []
    started.request()
    assert started.decode(b"".join(replies(2)), NOW) == []
    started.request()
    assert started.decode(b"".join(replies(3)), NOW) == [LEFT, RIGHT, *BEATS]


def test_counts_go_round(line: OdriveSerialCodec) -> None:
    for poll in range(200):
        line.request()
        asks = poll % 10 == 9
        texts = [*REPLIES, *STATES, *(["24.500000", "-1.250000"] * asks)]
        assert len(line.decode(b"".join(replies(poll, texts)), NOW)) == (4 + 2 * asks if poll else 0)
    assert not line.refused


def at_the_tenth_poll(line: OdriveSerialCodec) -> OdriveSerialCodec:
    for poll in range(1, 9):
        assert line.decode(b"".join(replies(poll)), NOW)
        line.request()
    return line


def test_supply_of_the_board_is_given_for_both_nodes(started: OdriveSerialCodec) -> None:
    line = at_the_tenth_poll(started)
    frames = line.decode(b"".join(replies(9, [*REPLIES, *STATES, "24.500000", "-1.250000"])), NOW)
    assert frames[:4] == [LEFT, RIGHT, *BEATS]
    data = bytes.fromhex("0000c4410000a0bf")  # 24.5 and -1.25 as 32-bit floats
    assert frames[4:] == [Frame(0x017, data, NOW), Frame(0x037, data, NOW)]
    assert not line.refused


@pytest.mark.parametrize("told", [("invalid property", "0.500000"), ("24.500000", "invalid property"), ("nan", "inf")])
def test_unknown_supply_leaves_the_other_replies_valid(started: OdriveSerialCodec, told: tuple[str, str]) -> None:
    line = at_the_tenth_poll(started)
    assert line.decode(b"".join(replies(9, [*REPLIES, *STATES, *told])), NOW) == [LEFT, RIGHT, *BEATS]
    assert not line.refused


@pytest.mark.parametrize("told", [(), ("24.500000",), ("24.500000", "1.000000", "1.000000")])
def test_a_poll_for_the_supply_with_replies_too_few_or_many_is_lost(
    started: OdriveSerialCodec, told: Sequence[str]
) -> None:
    line = at_the_tenth_poll(started)
    assert line.decode(b"".join(replies(9, [*REPLIES, *STATES, *told])), NOW) == []
    assert line.refused == {"lost": 1}


def test_supply_reply_to_a_poll_without_that_request_is_lost(started: OdriveSerialCodec) -> None:
    assert started.decode(b"".join(replies(1, [*REPLIES, *STATES, "24.500000", "1.000000"])), NOW) == []
    assert started.refused == {"lost": 1}


def settings_of(configure: Configure, poll: int, text: str) -> tuple[list[tuple[int, int, float]], Counter[str]]:
    """Node, number and value of each setting that the replies to a poll give, and what was refused."""
    line = OdriveSerialCodec(configure())
    found: list[Frame] = []
    for index in range(poll + 1):
        line.request()
        supply = ("24.5", "1.0") if index % 10 == 9 else ()
        own = (text if index == poll else "1",)
        found = line.decode(b"".join(replies(index, (*REPLIES, *STATES, *supply), own)), NOW)
    settings = [frame for frame in found if frame.arbitration_id % 32 == 0x05]
    return [(frame.arbitration_id // 32, *struct.unpack("<xHxf", frame.data)) for frame in settings], line.refused


@pytest.mark.parametrize(
    ("poll", "text", "expected"),
    [
        (1, "2.000000", [(0, 0, 2.0)]),
        (2, "40.000000", [(1, 0, 40.0)]),
        (3, "1", [(0, 1, 1.0)]),
        (4, "0", [(1, 1, 0.0)]),
        (13, "inf", [(0, 4, math.inf)]),
        (14, "-inf", [(1, 4, -math.inf)]),
        (14, "1000000.0", [(1, 4, 1e6)]),
        (14, "2.", [(1, 4, 2.0)]),
        (15, "-0.010000", [(0, 7, -0.01), (1, 7, -0.01)]),
        (16, "1", [(0, 8, 1.0), (1, 8, 1.0)]),
        (24, "1", [(0, 1, 1.0)]),
    ],
)
def test_settings_are_handed_on_by_their_number(
    configure: Configure, poll: int, text: str, expected: list[tuple[int, int, float]]
) -> None:
    found, refused = settings_of(configure, poll, text)
    assert [(node, number) for node, number, _ in found] == [(node, number) for node, number, _ in expected]
    assert [value for *_, value in found] == pytest.approx([value for *_, value in expected])
    assert not refused


def test_no_settings_are_asked_for_while_commands_pass_over_the_line(line: OdriveSerialCodec) -> None:
    line.encode(encode(Firmware.V0_5, 0, m.SetInputTorque(0.0)))
    line.request()
    line.encode(encode(Firmware.V0_5, 0, m.SetInputTorque(0.0)))
    assert b"config" not in line.request()
    assert line.decode(b"".join(replies(0)), NOW) == []
    assert line.decode(b"".join(replies(1, None, ())), NOW) == [LEFT, RIGHT, *BEATS]
    assert b"r axis1.controller.config.vel_limit*" in line.request()


def test_no_settings_are_asked_for_while_a_motor_is_on(started: OdriveSerialCodec) -> None:
    started.decode(b"".join(replies(1, (*REPLIES, "1", "0", "8", "0"))), NOW)
    assert b"config" not in started.request()
    started.decode(b"".join(replies(2, (*REPLIES, "1", "0", "1", "0"), ())), NOW)
    assert b"config" in started.request()


def test_a_setting_that_the_board_does_not_have_is_no_number(configure: Configure) -> None:
    ((_, _, value),), _ = settings_of(configure, 3, "invalid property")
    assert math.isnan(value)


@pytest.mark.parametrize("text", ["nan", "1e5", "True", "invalid motor 3", ""])
def test_a_reply_that_is_no_setting_costs_the_poll(configure: Configure, text: str) -> None:
    found, refused = settings_of(configure, 3, text)
    assert found == []
    assert refused == {"reply": 1}


@pytest.mark.parametrize(("behind", "taken"), [(2, True), (3, False)])
def test_replies_to_polls_of_long_ago_are_too_old(started: OdriveSerialCodec, behind: int, *, taken: bool) -> None:
    for _ in range(behind):
        started.request()
    assert bool(started.decode(b"".join(replies(1)), NOW)) is taken
    assert started.refused == ({} if taken else {"late": 1})


@pytest.mark.parametrize(
    "texts",
    [
        ("nan 0.0", REPLIES[1], *STATES),
        (REPLIES[0], "inf inf", *STATES),
        (f"{'9' * 39}.0 0.0", REPLIES[1], *STATES),
        ("1.5", REPLIES[1], *STATES),
        (*REPLIES, "256", "0", "1", "0"),
        (*REPLIES, "8", "0", "1", "4294967296"),
        (*REPLIES, "-1", "0", "1", "0"),
        (*REPLIES, "not implemented", "0", "1", "0"),
        (*STATES, *REPLIES),
    ],
)
def test_replies_that_do_not_answer_their_questions_are_refused(
    started: OdriveSerialCodec, texts: Sequence[str]
) -> None:
    assert started.decode(b"".join(replies(1, texts)), NOW) == []
    assert started.refused == {"reply": 1}
    started.request()
    assert started.decode(b"".join(replies(2)), NOW) == [LEFT, RIGHT, *BEATS]


@pytest.mark.parametrize("text", [b"1.5 0.25\r\n", b"1.500000 0.250000*1\r\n", b"1.5*x\r\n", b"*\r\n", b"a*0*1\n"])
def test_a_line_without_its_checksum_is_refused(started: OdriveSerialCodec, text: bytes) -> None:
    assert started.decode(text, NOW) == []
    assert started.refused == {"checksum": 1}


def test_a_line_without_an_end_is_dropped_and_the_next_one_taken(started: OdriveSerialCodec) -> None:
    assert started.decode(b"x" * 65, NOW) == []
    assert started.decode(b"x" * 1000, NOW) == []
    assert started.decode(b"y\n" + b"".join(replies(1)), NOW) == [LEFT, RIGHT, *BEATS]
    assert started.refused == {"length": 2}


def test_replies_without_end_take_no_memory(started: OdriveSerialCodec) -> None:
    for _ in range(100):
        started.decode(reply("1"), NOW)
    assert len(started._replies) < 12


def test_what_was_received_can_be_forgotten(started: OdriveSerialCodec) -> None:
    started.decode(b"".join(replies(1)[:2]) + b"8*", NOW)
    started.reset()
    assert started.decode(b"".join(replies(1)), NOW) == []
    started.request()
    assert started.decode(b"".join(replies(2, None, ())), NOW) == [LEFT, RIGHT, *BEATS], "settings come a poll later"


@given(st.lists(st.integers(1, 20), max_size=40))
def test_pieces_of_any_size_decode_alike(sizes: list[int]) -> None:
    line = _started()
    data = b"".join(replies(1))
    found: list[Frame] = []
    for size in sizes:
        found += line.decode(data[:size], NOW)
        data = data[size:]
    assert found + line.decode(data, NOW) == [LEFT, RIGHT, *BEATS]


@given(st.binary(max_size=200), st.sampled_from([b"\r", b"\n", b"\r\n"]))
def test_after_garbage_and_the_end_of_its_line_the_next_good_line_is_taken(garbage: bytes, end: bytes) -> None:
    line = _started()
    line.decode(garbage + end, NOW)
    line._replies.clear()  # what a good line among the garbage said
    assert line.decode(b"".join(replies(1)), NOW)[:2] == [LEFT, RIGHT]


def test_every_flipped_bit_in_a_poll_is_noticed() -> None:
    data = b"".join(replies(1))
    for bit in range(8 * len(data)):
        line = _started()
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        found = line.decode(bytes(damaged), NOW)
        # The end of a line is two characters, of which one is enough.
        ending = data[bit // 8] in b"\r\n"
        assert found == [] or (ending and found == [LEFT, RIGHT, *BEATS])
        line.request()
        line.decode(b"".join(replies(2)), NOW)
        line.request()
        assert line.decode(b"".join(replies(3)), NOW) == [LEFT, RIGHT, *BEATS]


@fuzzed
@given(st.integers(0, (1 << 32) - 1), st.integers(0, (1 << 32) - 1))
def test_whatever_replies_are_lost_or_cut_no_value_is_taken_for_another(kept: int, whole: int) -> None:
    line = _started()
    for poll in range(1, 5):
        data = b""
        for index, text in enumerate(replies(poll)):
            bit = 1 << (8 * (poll - 1) + index)
            if kept & bit or whole & bit:
                data += text if whole & bit else text[: len(text) // 2]
        assert set(line.decode(data, NOW)) <= TRUE
        line.request()


PIECES = [reply(text) for text in (*REPLIES, "8", "nan nan", "invalid motor 11", "invalid motor 12")]


@fuzzed
@given(st.binary(max_size=40))
def test_nothing_that_is_received_raises_or_makes_a_value_that_is_not_finite(drawn: bytes) -> None:
    line = _started()
    data = b"".join(PIECES[byte] if byte < len(PIECES) else bytes((byte,)) for byte in drawn)
    for frame in line.decode(data, NOW):
        if frame.arbitration_id % 32 == 0x09:
            assert all(math.isfinite(value) for value in struct.unpack("<ff", frame.data))


def _started() -> OdriveSerialCodec:
    left: dict[str, object] = {"node_id": 0, "axis": 0, "max_torque": 3.0}
    line = Line(_settings(left, {**left, "node_id": 1, "axis": 1}))
    line.request()
    line.decode(b"".join(replies(0)), NOW)
    line.request()
    return line


def _settings(left: dict[str, object], right: dict[str, object]) -> OdriveSettings:
    return msgspec.convert({"type": "odrive", "axes": {"left": left, "right": right}}, OdriveSettings)
