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


def test_telemetry_that_is_not_the_devices_alone_is_named_with_its_rate_and_the_remedy() -> None:
    now = Now()
    strangers = Strangers([], now)
    strangers.note_another_sender(FrameKey(0x121), 5 * MS)
    strangers.note_another_sender(FrameKey(0x120), 5 * MS)
    assert strangers.is_recent
    found = strangers.report()
    assert found.startswith(
        "more telemetry than the device sends, 0x120 (every 5 ms), 0x121 (every 5 ms): somebody else"
    )
    assert "find it and stop it" in found
    assert list(strangers.arming_failures()) == [f"within the last second, {found}"]
    now.ns += 1_000 * MS

    assert (strangers.report(), strangers.is_recent, list(strangers.arming_failures())) == ("", False, [])
    assert (strangers.total, strangers.doubled) == (0, 2)


def test_commands_and_telemetry_are_named_together() -> None:
    strangers = Strangers([FrameKey(0x110)], Now())
    strangers.take_frame(Frame(0x110, b""))
    strangers.note_another_sender(FrameKey(0x120), 5 * MS)

    assert "0x110 (1)" in strangers.report().split("; more telemetry")[0]
    assert [reason.partition(" ")[0] for reason in strangers.arming_failures()] == ["another", "within"]
