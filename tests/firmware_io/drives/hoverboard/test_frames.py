# SPDX-License-Identifier: MIT
"""The bytes of a hoverboard's line, against packets put together by hand from the firmware's structures."""

import random
import struct

import pytest

from segway_ecc.firmware_io.drives.hoverboard.frames import (
    COMMAND,
    FEEDBACK,
    Feedback,
    HoverboardCodec,
    command_frame,
    read_feedback,
)
from segway_ecc.firmware_io.drives.hoverboard.settings import HoverboardSettings, HoverboardWheelSettings
from segway_ecc.firmware_io.drives.hoverboard.stopper import HoverboardStopper
from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.settings import PortSettings

WHEEL = HoverboardWheelSettings(torque_constant=0.25, max_torque=3.0)
STANDARD = HoverboardSettings(serial=PortSettings(port="test"), left=WHEEL, right=WHEEL, serial_timeout_cycles=160)
ODOMETRY = HoverboardSettings(
    serial=PortSettings(port="test"), left=WHEEL, right=WHEEL, serial_timeout_cycles=160, feedback="odometry"
)
RPM = 0.10471975511965977
"""One turn a minute, rad/s."""

# start, cmd1, cmd2, speedR, speedL, batVoltage, boardTemp, cmdLed, checksum: 100, -100, -60 rpm, 60 rpm, 36.5 V, 31.2 C
PACKET = bytes.fromhex("cdab 6400 9cff c4ff 3c00 420e 3801 0000 b7a4".replace(" ", ""))


def packet(*words: int) -> bytes:
    checksum = 0
    for word in (0xABCD, *words):
        checksum ^= word & 0xFFFF
    return struct.pack(f"<{len(words) + 2}H", 0xABCD, *(word & 0xFFFF for word in words), checksum)


def decode(data: bytes, settings: HoverboardSettings = STANDARD) -> list[Feedback]:
    return [read_feedback(frame.data) for frame in HoverboardCodec(settings).decode(data, 7)]


def test_a_command_is_eight_bytes_with_the_exclusive_or_of_all_words() -> None:
    codec = HoverboardCodec(STANDARD)
    # The packet of issue 97 of the firmware: steer 0, speed 90.
    assert codec.encode(command_frame(0, 90)) == bytes([205, 171, 0, 0, 90, 0, 151, 171])
    assert codec.encode(command_frame(-1000, 1000)) == packet(-1000, 1000)
    assert codec.encode(Frame(FEEDBACK, bytes(14))) is None
    assert codec.request() == b""


def test_feedback_by_hand() -> None:
    (found,) = decode(PACKET)
    assert found.commands == (100, -100)
    assert found.velocities == pytest.approx((60.5 * RPM, 59.5 * RPM))
    assert found.ticks == ()
    assert (found.voltage, found.temperature) == pytest.approx((36.5, 31.2))


def test_feedback_with_odometry_has_the_counts_between_speeds_and_voltage() -> None:
    (found,) = decode(packet(0, 0, 0, 0, 8_999, 12, 3_600, 250, 0), ODOMETRY)
    assert found == Feedback((0, 0), (0.0, 0.0), (12, 8_999), 36.0, 25.0)


def test_a_speed_is_the_middle_of_what_it_was_rounded_down_from() -> None:
    """A robot that rolls straight: the mirrored motor is rounded the other way, and would make it turn."""
    for true in (7.25, 30.5, 100.99):
        (found,) = decode(packet(0, 0, int(-true // 1), int(true // 1), 3_600, 250, 0))
        left, right = found.velocities
        assert left == pytest.approx(right)
        assert left == pytest.approx(true * RPM, abs=0.5 * RPM)


@pytest.mark.parametrize("size", [1, 3, 17, 18, 25])
def test_packets_are_found_in_pieces_of_any_size(size: int) -> None:
    codec, data = HoverboardCodec(STANDARD), b"\xcd" + PACKET * 5
    frames = [f for at in range(0, len(data), size) for f in codec.decode(data[at : at + size], at)]
    assert [frame.data for frame in frames] == [PACKET[2:-2]] * 5
    assert {frame.arbitration_id for frame in frames} == {FEEDBACK}
    assert codec.refused == {"garbage": 1}


def test_after_garbage_the_next_packet_is_found() -> None:
    codec, chance = HoverboardCodec(STANDARD), random.Random(3)  # noqa: S311 - repeatable, and no secret
    for _ in range(300):
        noise = chance.randbytes(chance.randrange(40))
        broken = bytearray(PACKET)
        broken[chance.randrange(len(broken))] ^= 1 << chance.randrange(8)
        codec.decode(noise + bytes(broken), 0)
        assert len(codec.decode(PACKET * 2, 0)) >= 1
    assert codec.refused["checksum"] > 0
    codec.decode(PACKET[:9], 0)
    codec.reset()
    assert len(codec.decode(PACKET, 0)) == 1


def test_what_cannot_be_is_refused() -> None:
    for words in (
        (1_001, 0, 0, 0, 3_600, 250, 0),
        (0, -1_001, 0, 0, 3_600, 250, 0),
        (0, 0, 2_048, 0, 3_600, 250, 0),
        (0, 0, 0, -2_048, 3_600, 250, 0),
        (0, 0, 0, 0, -1, 0, 3_600, 250, 0),
        (0, 0, 0, 0, 0, 9_000, 3_600, 250, 0),
    ):
        with pytest.raises(FrameRefusedError) as caught:
            read_feedback(packet(*words)[2:-2])
        assert caught.value.refusal is Refusal.RANGE
    with pytest.raises(FrameRefusedError) as caught:
        read_feedback(bytes(16))
    assert caught.value.refusal is Refusal.LENGTH


def test_the_guard_reads_commands_and_stops_with_zero() -> None:
    stopper = HoverboardStopper()
    assert stopper.read(command_frame(0, 1)) == Observation("board", Meaning.MOVE)
    assert stopper.read(command_frame(0, 0)) == Observation("board", Meaning.DISABLE)
    for other in (Frame(FEEDBACK, bytes(14)), Frame(COMMAND, bytes(3)), Frame(COMMAND, bytes(4), is_extended=True)):
        assert stopper.read(other) is None
    (stop,) = stopper.stop()
    assert HoverboardCodec(STANDARD).encode(stop) == packet(0, 0)
