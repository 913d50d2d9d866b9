# SPDX-License-Identifier: MIT
"""What the guard reads in frames of moteus controllers, and its stop frames, against bytes written by hand."""

import random
import struct

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.guard.guard import stopper_of
from segway_ecc.firmware_io.links.link import FD_LENGTHS, Frame
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.node.config import load_robot

MOVE, ZERO, DISABLE, ON, OFF = Meaning
NAN, ZERO_F = "0000c07f", "00000000"
STOPPER = stopper_of(hardware_of(load_robot("cart-moteus")))
HALF, MINUS_ZERO = struct.pack("<f", 0.5).hex(), struct.pack("<f", -0.0).hex()


def torque(value: str, kp: str = ZERO_F) -> bytes:
    """As the node commands it, with the scale of kp."""
    return bytes.fromhex(f"01000a0c0620{NAN}{ZERO_F}{value}{kp}{ZERO_F}00004040" + "0d270ad7233d")


def answer(mode: int) -> bytes:
    return bytes.fromhex(f"2100{mode:02x}2f01{ZERO_F * 3}2d0d00001042220e1f002527280050")


def test_it_names_its_drives_and_they_report() -> None:
    assert (list(STOPPER.drives), STOPPER.reports) == (["left", "right"], True)


@pytest.mark.parametrize(("servo_id", "name"), [(1, "left"), (2, "right")])
@pytest.mark.parametrize(
    ("source", "data", "meaning"),
    [
        (0x80, torque(HALF), MOVE),
        (0x80, torque(ZERO_F), ZERO),
        (0x80, torque(ZERO_F, kp=HALF), MOVE),
        (0x80, torque(MINUS_ZERO), MOVE),
        (0x80, bytes.fromhex("010000"), DISABLE),
        (0x00, bytes.fromhex("010000"), DISABLE),
        (0x85, bytes.fromhex("01000a" + "0e20" + ZERO_F * 2), MOVE),
        (0x80, bytes.fromhex("01000f"), MOVE),
        (0x80, bytes.fromhex("0500000a00"), MOVE),
        (0x80, bytes.fromhex("1f01"), None),
        (0x80, bytes.fromhex("100100"), None),
        (0x80, bytes.fromhex("420130"), None),
        (0x80, b"", None),
    ],
)
def test_what_a_command_means(servo_id: int, name: str, source: int, data: bytes, meaning: Meaning | None) -> None:
    frame = Frame(source << 8 | servo_id, data, is_extended=source > 7, is_fd=True)
    assert STOPPER.read(frame) == (None if meaning is None else Observation(name, meaning))
    assert STOPPER.read(replace(frame, is_remote=True)) is None
    assert STOPPER.read(replace(frame, arbitration_id=1 << 16 | frame.arbitration_id, is_extended=True)) is None
    assert STOPPER.read(replace(frame, arbitration_id=source << 8 | 3)) is None


@pytest.mark.parametrize("mode", range(16))
def test_modes_without_torque_are_off(mode: int) -> None:
    wanted = OFF if mode in (0, 1, 2, 3, 4, 11) else ON
    assert STOPPER.read(Frame(0x100, answer(mode), is_fd=True)) == Observation("left", wanted)
    assert STOPPER.read(Frame(0x200, answer(mode), is_fd=True)) == Observation("right", wanted)
    assert STOPPER.read(Frame(0x27E, answer(mode), is_fd=True)) == Observation("right", wanted), (
        "asked beside the cycle"
    )


def test_an_answer_that_is_not_whole_means_nothing() -> None:
    assert STOPPER.read(Frame(0x100, answer(10)[:-1], is_fd=True)) is None
    assert STOPPER.read(Frame(0x100, answer(10))) is None
    assert STOPPER.read(Frame(0x100, answer(16), is_fd=True)) is None
    assert STOPPER.read(Frame(0x300, answer(10), is_fd=True)) is None


def test_each_is_stopped_and_asked() -> None:
    stop = STOPPER.stop()
    assert [(frame.arbitration_id, frame.is_extended, frame.is_fd) for frame in stop] == [
        (0x8001, True, True),
        (0x8002, True, True),
    ]
    wanted = bytes.fromhex("010000" + "0d270ad7233d" + "11001f011d0d120e1527" + "50")
    assert {frame.data for frame in stop} == {wanted}


def test_no_frame_at_all_makes_reading_fail() -> None:
    chance = random.Random(1)  # noqa: S311 - noise, and the same every time
    for identifier in (*range(0x400), *range(0x8000, 0x8400), 0x8001, 0x100):
        for length in FD_LENGTHS:
            frame = Frame(identifier, chance.randbytes(length), is_extended=identifier > 0x7FF, is_fd=True)
            heard = STOPPER.read(frame)
            assert heard is None or heard.drive in STOPPER.drives
