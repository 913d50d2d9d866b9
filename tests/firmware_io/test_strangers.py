# SPDX-License-Identifier: MIT
"""Frames of others that command our drives."""

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.strangers import Strangers

MS = 1_000_000
CLOSING = ": another controller commands this robot's drives, or a recording is played; find it and stop it"


class Now:
    def __init__(self) -> None:
        self.ns = 5_000 * MS

    def __call__(self) -> int:
        return self.ns


def test_frames_that_command_our_drives_are_named_and_counted() -> None:
    strangers = Strangers([FrameKey(0x110), FrameKey(0x111), FrameKey(0x1, is_extended=True)], Now())
    for frame in (Frame(0x111, b""), Frame(0x110, b"1"), Frame(0x110, b"2"), Frame(0x1, b"", 0, is_extended=True)):
        strangers.take_frame(frame)

    assert strangers.report() == f"command frames that this node did not send, 0x1 (1), 0x110 (2), 0x111 (1){CLOSING}"
    assert strangers.report() == ""
    assert strangers.total == 4


def test_other_frames_are_somebody_else_s() -> None:
    strangers = Strangers([FrameKey(0x110)], Now())
    strangers.take_frame(Frame(0x112, b""))
    strangers.take_frame(Frame(0x110, b"", 0, is_extended=True))

    assert (strangers.report(), strangers.total, strangers.is_recent) == ("", 0, False)


def test_no_more_than_four_are_named() -> None:
    strangers = Strangers([FrameKey(number) for number in range(100)], Now())
    for number in range(100):
        strangers.take_frame(Frame(number, b""))

    assert (
        strangers.report() == f"command frames that this node did not send, 0x0 (1), 0x1 (1), 0x2 (1), 0x3 (1){CLOSING}"
    )


def test_they_are_recent_for_a_second() -> None:
    now = Now()
    strangers = Strangers([FrameKey(0x110)], now)
    strangers.take_frame(Frame(0x110, b""))
    now.ns += 1_000 * MS - 1
    assert strangers.is_recent
    now.ns += 1

    assert not strangers.is_recent
