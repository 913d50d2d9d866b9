# SPDX-License-Identifier: MIT
from collections.abc import Callable

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.wheel_board.frames import (
    BoardSetup,
    Endpoint,
    FrameId,
    Payload,
    Wheel,
    WheelCommand,
    encode,
)
from segway_ecc.firmware_io.integrity import Refusal
from segway_ecc.firmware_io.links.link import Frame, Link

LEFT, RIGHT = FrameId.LEFT_WHEEL, FrameId.RIGHT_WHEEL
HEARD = frozenset({LEFT, RIGHT})
WHEEL = Wheel(1.0, -2.0)


@pytest.fixture
def endpoint(link: Link) -> Endpoint:
    return Endpoint(link.send, HEARD)


def _frame(counter: int, frame_id: FrameId = LEFT) -> Frame:
    return Frame(frame_id, encode(frame_id, WHEEL, counter))


def _take(endpoint: Endpoint, *frames: Frame) -> list[Payload]:
    """Those of the frames that are taken."""
    return [payload for frame in frames if (payload := endpoint.check(frame)) is not None]


def _corrupt(frame: Frame) -> Frame:
    return replace(frame, data=bytes((frame.data[0] ^ 1, *frame.data[1:])))


def test_every_identifier_has_its_own_running_counter(endpoint: Endpoint, sent: list[Frame]) -> None:
    command, setup = WheelCommand(1.0, 2.0, enable=True), BoardSetup(0.05)
    for _ in range(17):
        assert endpoint.send(FrameId.WHEEL_COMMAND, command)
    endpoint.send(FrameId.BOARD_SETUP, setup)

    commands = [Frame(FrameId.WHEEL_COMMAND, encode(FrameId.WHEEL_COMMAND, command, n % 16)) for n in range(17)]
    assert sent == [*commands, Frame(FrameId.BOARD_SETUP, encode(FrameId.BOARD_SETUP, setup, 0))]


def test_what_the_link_dropped_leaves_a_gap_that_the_other_end_counts(
    endpoint: Endpoint, sent: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoint.send(LEFT, WHEEL)
    with monkeypatch.context() as full:
        full.setattr(endpoint, "_send", lambda _: False)
        assert not endpoint.send(LEFT, WHEEL)
    endpoint.send(LEFT, WHEEL)

    assert len(_take(endpoint, *sent)) == 2
    assert endpoint.lost == 1


def test_intact_frames_are_taken(endpoint: Endpoint) -> None:
    frames = [_frame(9, RIGHT), _frame(3, LEFT), _frame(10, RIGHT)]
    assert [endpoint.check(frame) for frame in frames] == [WHEEL, WHEEL, WHEEL]
    assert (endpoint.refused, endpoint.lost) == ({}, 0)


def test_lost_frames_are_counted_over_all_identifiers(endpoint: Endpoint) -> None:
    assert len(_take(endpoint, _frame(0), _frame(2), _frame(14, RIGHT), _frame(1, RIGHT))) == 4
    assert endpoint.lost == 1 + 2


def test_after_a_restart_any_counter_is_taken_once_and_nothing_counts_as_lost(endpoint: Endpoint) -> None:
    assert len(_take(endpoint, _frame(0), _frame(2), _frame(7, RIGHT))) == 3
    endpoint.restart()
    assert len(_take(endpoint, _frame(2), _frame(1, RIGHT), _frame(4))) == 3
    assert endpoint.lost == 2
    assert endpoint.refused == {}


@pytest.mark.parametrize("second", [5, 12, 4], ids=["repeated", "seven ahead", "one back"])
def test_a_count_out_of_sequence_is_refused_and_then_followed(endpoint: Endpoint, second: int) -> None:
    frames = [_frame(5), _frame(second), _frame(second + 1)]
    assert [endpoint.check(frame) for frame in frames] == [WHEEL, None, WHEEL]
    assert endpoint.refused == {Refusal.COUNTER: 1}


def test_a_bad_frame_is_counted_by_its_cause_and_leaves_the_counter_alone(
    endpoint: Endpoint,
) -> None:
    good, bad = _frame(0), _frame(1)
    taken = _take(endpoint, good, _corrupt(bad), _corrupt(bad), Frame(LEFT, bad.data[:7]), Frame(LEFT, b""), bad)

    assert len(taken) == 2
    assert endpoint.refused == {Refusal.CRC: 2, Refusal.LENGTH: 2}
    assert endpoint.lost == 0


def test_a_value_out_of_range_is_counted(link: Link, reference_crc: Callable[[bytes], int]) -> None:
    board = Endpoint(link.send, frozenset({FrameId.WHEEL_COMMAND}))
    body = b"\x00\x80\x00\x00\x01\x00\x00"  # -32.768 V on the left
    frame = Frame(FrameId.WHEEL_COMMAND, body + bytes((reference_crc(body + b"\x10\x01"),)))

    assert board.check(frame) is None
    assert board.refused == {Refusal.RANGE: 1}


@pytest.mark.parametrize(
    "foreign",
    [
        Frame(0x7FF, bytes(8)),
        Frame(0, b""),
        Frame(FrameId.WHEEL_COMMAND, encode(FrameId.WHEEL_COMMAND, WheelCommand(0.0, 0.0, enable=False), 0)),
        Frame(LEFT, encode(LEFT, WHEEL, 0), is_extended=True),
        Frame(LEFT, b"damaged", is_extended=True),
    ],
    ids=["unknown", "zero", "for the other end", "extended", "extended and damaged"],
)
def test_what_is_somebody_elses_is_passed_over_uncounted(endpoint: Endpoint, foreign: Frame) -> None:
    assert endpoint.check(foreign) is None
    assert (endpoint.refused, endpoint.lost) == ({}, 0)
