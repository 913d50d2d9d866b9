# SPDX-License-Identifier: MIT
"""Firmware and current limits, from packets written by hand."""

import contextlib
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.vesc.limits import (
    CurrentLimits,
    FirmwareVersion,
    LimitsReading,
    decode_limits,
    decode_version,
)
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal

MS = 1_000_000
V6 = FirmwareVersion(6, 0, "60_MK5")
VERSION = b"\x00\x06\x00" + b"60_MK5\x00" + bytes(range(12)) + b"\x00"
SIGNATURE = 776184161


def mcconf(*currents: float) -> bytes:
    """An answer to GET_MCCONF: signature, FOC with a sensor, the four limits, and the rest of 480 bytes."""
    return (b"\x0e" + struct.pack(">IBBBB4f", SIGNATURE, 0, 0, 2, 0, *currents)).ljust(481, b"\x01")


def test_version_has_the_hardwares_name_or_none() -> None:
    assert decode_version(VERSION) == V6
    assert str(V6) == "6.00 on 60_MK5"
    assert str(decode_version(b"\x00\x03\x28")) == "3.40"
    assert decode_version(b"\x00\x05\x02A\xff\x01B").hardware == "A\ufffdB"


@pytest.mark.parametrize("packet", [b"", b"\x04\x06\x00", b"\x00\x06"])
def test_version_of_another_or_short_packet_is_refused(packet: bytes) -> None:
    with pytest.raises(FrameRefusedError):
        decode_version(packet)


@pytest.mark.parametrize("version", [(6, 0), (6, 5)])
def test_limits_stand_behind_signature_and_modes(version: tuple[int, int]) -> None:
    packet = mcconf(60.0, -45.0, 30.0, -12.5)
    assert decode_limits(FirmwareVersion(*version), packet) == CurrentLimits(60.0, -45.0, 30.0, -12.5)


@pytest.mark.parametrize(
    ("version", "packet", "refusal"),
    [
        ((5, 2), mcconf(60.0, -60.0, 30.0, -30.0), Refusal.UNKNOWN),
        ((6, 0), b"\x11" + bytes(480), Refusal.UNKNOWN),
        ((6, 0), mcconf(60.0, -60.0, 30.0, -30.0)[:24], Refusal.LENGTH),
        ((6, 0), mcconf(-60.0, -60.0, 30.0, -30.0), Refusal.RANGE),
        ((6, 0), mcconf(60.0, -60.0, 30.0, 30.0), Refusal.RANGE),
        ((6, 0), mcconf(float("nan"), -60.0, 30.0, -30.0), Refusal.RANGE),
        ((6, 0), mcconf(60.0, float("-inf"), 30.0, -30.0), Refusal.RANGE),
    ],
)
def test_limits_that_are_none_are_refused(version: tuple[int, int], packet: bytes, refusal: Refusal) -> None:
    with pytest.raises(FrameRefusedError) as raised:
        decode_limits(FirmwareVersion(*version), packet)
    assert raised.value.refusal is refusal


@given(st.binary(max_size=64), st.integers(0, 7), st.integers(0, 7))
def test_garbage_is_refused_or_within_range(packet: bytes, major: int, minor: int) -> None:
    with contextlib.suppress(FrameRefusedError):
        decode_version(b"\x00" + packet)
    with contextlib.suppress(FrameRefusedError):
        limits = decode_limits(FirmwareVersion(major, minor), b"\x0e" + packet)
        assert limits.motor_min <= 0.0 <= limits.motor_max


def answer_version(reading: LimitsReading, packet: bytes = VERSION) -> None:
    """Answer twice, which is believed."""
    for _ in range(2):
        assert reading.next_question(0) == b"\x00"
        reading.take(packet)


def read(*currents: float, needed_a: float = 30.0) -> LimitsReading:
    reading = LimitsReading("the left VESC", needed_a)
    answer_version(reading)
    assert reading.next_question(1) == b"\x0e"
    reading.take(mcconf(*currents))
    return reading


def test_version_is_asked_and_then_the_configuration() -> None:
    reading = read(60.0, -60.0, 30.0, -10.0)
    assert reading.is_over
    assert reading.next_question(10**12) is None
    assert reading.arming_failures() == []
    assert reading.description == "6.00 on 60_MK5; motor -60 to 60 A, input -10 to 30 A"


def test_one_frame_that_reads_as_a_version_is_not_believed_and_asked_about_at_once() -> None:
    reading = LimitsReading("the left VESC", 30.0)
    assert reading.next_question(0) == b"\x00"
    reading.take(b"\x00\x05\x02")
    answer_version(reading)
    assert (reading.version, reading.unconfirmed) == (V6, 1)


@pytest.mark.parametrize("currents", [(29.0, -60.0), (60.0, -29.0)])
def test_limits_below_what_the_torque_takes_refuse_arming(currents: tuple[float, float]) -> None:
    (failure,) = read(*currents, 30.0, -10.0).arming_failures()
    assert f"allows {currents[0]:g} A of motor current and {-currents[1]:g} A to brake" in failure
    assert "max_torque takes 30 A" in failure
    assert "raise Motor Current Max and Motor Current Max Brake" in failure
    assert read(30.0, -29.999, 30.0, -10.0).arming_failures() == [], "equal, but for a float of 32 bits"


def test_a_question_is_repeated_twice_and_then_given_up() -> None:
    reading = LimitsReading("the left VESC", 30.0)
    asked = [moment for moment in range(400) if reading.next_question(moment * MS) is not None]
    assert asked == [0, 50, 100]
    assert reading.is_over
    assert reading.arming_failures() == []
    assert reading.description == "did not answer FW_VERSION"


def test_the_first_question_waits_for_the_other_controller() -> None:
    reading = LimitsReading("the left VESC", 30.0, 100 * MS)
    asked = [moment for moment in range(400) if reading.next_question((moment + 7) * MS) is not None]
    assert asked == [100, 150, 200]


def test_limits_are_not_asked_for_where_their_long_answer_would_change_the_line() -> None:
    reading = LimitsReading("the left VESC", 30.0, has_fallback=True)
    answer_version(reading)
    assert reading.next_question(10**12) is None
    assert reading.arming_failures() == []
    assert reading.description == (
        "6.00 on 60_MK5; its limits are not read where there is a serial line: see VESC Tool"
    )


def test_until_it_is_read_arming_waits() -> None:
    reading = LimitsReading("the left VESC", 30.0)
    waits = ["the firmware and limits of the left VESC are being read; try again in a moment"]
    assert (reading.arming_failures(), reading.description) == (waits, "being asked")
    answer_version(reading)
    assert (reading.arming_failures(), reading.description) == (waits, "6.00 on 60_MK5, being asked")
    for moment in range(0, 400, 10):
        reading.next_question(moment * MS)
    assert (reading.arming_failures(), reading.description) == ([], "6.00 on 60_MK5; its limits are not reported")


def test_unknown_version_is_reported_and_its_limits_are_not_guessed() -> None:
    reading = LimitsReading("the left VESC", 30.0)
    answer_version(reading, b"\x00\x05\x02410\x00")
    assert reading.next_question(10**12) is None
    assert reading.arming_failures() == []
    assert reading.description == (
        "5.02 on 410; its limits are not read, their place is known for 6.00, 6.05: see VESC Tool"
    )


def test_limits_that_cannot_be_read_are_not_asked_for_again() -> None:
    reading = LimitsReading("the left VESC", 30.0)
    answer_version(reading)
    over = []
    for packet in (b"\x00", mcconf(-1.0, 1.0, 0.0, 0.0)):  # the first answers another question and changes nothing
        with pytest.raises(FrameRefusedError):
            reading.take(packet)
        over.append(reading.is_over)
    assert over == [False, True]
    assert reading.limits is None
