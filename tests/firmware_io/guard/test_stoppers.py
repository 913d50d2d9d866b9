# SPDX-License-Identifier: MIT
"""What the guard reads in each family's frames, and its stop frames, against bytes written by hand."""

import random
import struct

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.stopper import Meaning, Observation, Stopper
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.drives.wheel_board.frames import BoardState, BoardStatus, FrameId, WheelCommand, encode
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.guard.guard import stopper_of
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.settings import HardwareSettings
from segway_ecc.node.config import NoHardwareSection, load_robot

ROBOTS = ["cart-can", "cart-odrive", "cart-vesc", "cart-cia402"]
MOVE, ZERO, DISABLE, ON, OFF = Meaning

VERSION_1 = WheelBoardSettings(protocol=1)


def hardware(robot: str) -> HardwareSettings:
    settings = load_robot(robot).hardware
    assert not isinstance(settings, NoHardwareSection)
    return settings


def ids(robot: str) -> tuple[int, int]:
    """The two drives' numbers on the bus, from the robot file."""
    settings = hardware(robot)
    assert isinstance(settings, OdriveSettings | VescSettings | Cia402Settings)
    names = {"cart-odrive": "node_id", "cart-vesc": "controller_id", "cart-cia402": "node_id"}
    left, right = (getattr(wheel, names[robot]) for wheel in settings.axes.values())
    return left, right


def command(counter: int, *, enable: bool, voltage: float = 0.0) -> Frame:
    payload = WheelCommand(voltage, voltage, enable)
    return Frame(FrameId.WHEEL_COMMAND, encode(FrameId.WHEEL_COMMAND, payload, counter))


def read(stopper: Stopper, frame: Frame) -> Meaning | None:
    heard = stopper.read(frame)
    return None if heard is None else heard.meaning


@pytest.mark.parametrize(
    ("robot", "drives", "reports"),
    [
        ("cart-can", ["board"], True),
        ("cart-odrive", ["left", "right"], True),
        ("cart-vesc", ["left", "right"], False),
        ("cart-cia402", ["left", "right"], True),
    ],
)
def test_family_names_its_drives(robot: str, drives: list[str], *, reports: bool) -> None:
    stopper = stopper_of(hardware(robot))

    assert list(stopper.drives) == drives
    assert stopper.reports is reports


def test_what_a_wheel_board_s_frames_mean() -> None:
    stopper = stopper_of(VERSION_1)
    states = {state: encode(FrameId.BOARD_STATUS, BoardStatus(state, 36.0, 0.05, 0), 3) for state in BoardState}

    assert stopper.read(command(1, enable=True)) == Observation("board", MOVE)
    assert read(stopper, command(1, enable=True, voltage=2.0)) is MOVE
    assert read(stopper, command(1, enable=False)) is DISABLE
    assert {state: stopper.read(Frame(0x130, data)) for state, data in states.items()} == {
        BoardState.DISABLED: Observation("board", OFF),
        BoardState.ENABLED: Observation("board", ON),
        BoardState.WATCHDOG: Observation("board", OFF),
        BoardState.FAULT: Observation("board", OFF),
    }


def test_what_is_not_a_wheel_board_s_frame_means_nothing() -> None:
    stopper = stopper_of(VERSION_1)
    good = command(1, enable=True)
    flipped = bytes((good.data[0] ^ 1, *good.data[1:]))

    assert stopper.read(replace(good, is_extended=True)) is None
    assert stopper.read(replace(good, arbitration_id=0x120)) is None
    assert stopper.read(replace(good, data=flipped)) is None
    assert stopper.read(replace(good, data=good.data[:7])) is None


def test_a_wheel_board_s_stop_frames_count_on_where_the_node_was() -> None:
    stopper = stopper_of(VERSION_1)
    stopper.read(command(14, enable=True))
    off = [Frame(0x110, encode(FrameId.WHEEL_COMMAND, WheelCommand(0.0, 0.0, enable=False), n)) for n in (15, 16, 1, 2)]

    assert [*stopper.stop(), *stopper.stop()] == off


def test_a_wheel_board_is_stopped_although_nothing_was_heard_of_the_node() -> None:
    assert [frame.data[6] & 15 for frame in stopper_of(VERSION_1).stop()] == [1, 2]


def test_a_wheel_board_s_status_does_not_move_the_counter() -> None:
    stopper = stopper_of(VERSION_1)
    stopper.read(command(4, enable=True))
    stopper.read(Frame(0x130, encode(FrameId.BOARD_STATUS, BoardStatus(BoardState.ENABLED, 36.0, 0.05, 0), 9)))

    assert [frame.data[6] & 15 for frame in stopper.stop()] == [5, 6]


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(
    ("number", "data", "meaning"),
    [
        (0x0E, struct.pack("<f", 0.25), MOVE),
        (0x0E, struct.pack("<fI", -0.25, 0), MOVE),
        (0x0E, struct.pack("<f", 0.0), ZERO),
        (0x0E, struct.pack("<f", float("nan")), None),
        (0x0E, b"\0\0\0", None),
        (0x07, struct.pack("<I", 8), MOVE),
        (0x07, struct.pack("<I", 3), MOVE),
        (0x07, struct.pack("<I", 1), DISABLE),
        (0x0C, struct.pack("<fhh", 0.0, 0, 0), MOVE),
        (0x0D, struct.pack("<ff", 0.0, 0.0), MOVE),
        (0x0B, struct.pack("<II", 1, 1), None),
        (0x18, b"", None),
        (0x01, struct.pack("<IBBBB", 0, 8, 0, 0, 0), ON),
        (0x01, struct.pack("<IBBBB", 0, 1, 0, 0, 0), OFF),
        (0x01, struct.pack("<IBBBB", 0, 3, 0, 0, 0), OFF),
        (0x09, struct.pack("<ff", 1.0, 1.0), None),
        (0x1F, b"", None),
    ],
)
def test_what_an_odrive_s_frames_mean(side: int, number: int, data: bytes, meaning: Meaning | None) -> None:
    stopper = stopper_of(hardware("cart-odrive"))
    frame = Frame(ids("cart-odrive")[side] * 32 + number, data)
    wanted = None if meaning is None else Observation(("left", "right")[side], meaning)

    assert stopper.read(frame) == wanted
    assert stopper.read(replace(frame, is_extended=True)) is None
    assert stopper.read(replace(frame, is_remote=True)) is None


def test_an_odrive_is_stopped_by_zero_torque_and_idle() -> None:
    left, right = ids("cart-odrive")
    zero, idle = struct.pack("<f", 0.0), struct.pack("<I", 1)

    stop = stopper_of(hardware("cart-odrive")).stop()
    assert [(f.arbitration_id, f.data[:4], f.is_extended) for f in stop] == [
        (left * 32 + 0x0E, zero, False),
        (left * 32 + 0x07, idle, False),
        (right * 32 + 0x0E, zero, False),
        (right * 32 + 0x07, idle, False),
    ]


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(
    ("number", "data", "meaning"),
    [
        (1, struct.pack(">i", 1_000), MOVE),
        (1, struct.pack(">i", -1), MOVE),
        (1, struct.pack(">i", 0), DISABLE),
        (1, b"\0\0\0", None),
        (0, struct.pack(">i", 0), MOVE),
        (2, struct.pack(">i", 0), MOVE),
        (13, struct.pack(">i", 0), MOVE),
        (8, b"\0\0\0", None),
        (9, struct.pack(">ihh", 100, 10, 0), None),
        (77, b"", None),
    ],
)
def test_what_a_vesc_s_frames_mean(side: int, number: int, data: bytes, meaning: Meaning | None) -> None:
    stopper = stopper_of(hardware("cart-vesc"))
    frame = Frame(number << 8 | ids("cart-vesc")[side], data, is_extended=True)
    wanted = None if meaning is None else Observation(("left", "right")[side], meaning)

    assert stopper.read(frame) == wanted
    assert stopper.read(replace(frame, is_extended=False)) is None
    assert stopper.read(replace(frame, is_remote=True)) is None


def test_a_vesc_is_stopped_by_zero_current() -> None:
    left, right = ids("cart-vesc")

    stop = stopper_of(hardware("cart-vesc")).stop()
    assert stop == [Frame(1 << 8 | number, bytes(4), is_extended=True) for number in (left, right)]


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(
    ("base", "data", "meaning"),
    [
        (0x200, struct.pack("<Hh", 0x0F, 0), MOVE),
        (0x200, struct.pack("<Hh", 0x1F, 100), MOVE),
        (0x200, struct.pack("<Hh", 0x07, 0), DISABLE),
        (0x200, struct.pack("<Hh", 0x06, 0), DISABLE),
        (0x200, struct.pack("<Hh", 0x0E, 0), DISABLE),
        (0x200, struct.pack("<Hh", 0x00, 0), DISABLE),
        (0x200, b"\x0f\0\0", None),
        (0x180, struct.pack("<Hih", 0x0637, 0, 0), ON),
        (0x180, struct.pack("<Hih", 0x0617, 0, 0), ON),
        (0x180, struct.pack("<Hih", 0x061F, 0, 0), ON),
        (0x180, struct.pack("<Hih", 0x0633, 0, 0), OFF),
        (0x180, struct.pack("<Hih", 0x0650, 0, 0), OFF),
        (0x180, struct.pack("<Hih", 0x0618, 0, 0), OFF),
        (0x180, struct.pack("<Hih", 0x0047, 0, 0), None),
        (0x180, b"\0", None),
        (0x280, bytes(4), None),
        (0x700, b"\x05", None),
    ],
)
def test_what_a_cia_402_drive_s_frames_mean(side: int, base: int, data: bytes, meaning: Meaning | None) -> None:
    stopper = stopper_of(hardware("cart-cia402"))
    frame = Frame(base + ids("cart-cia402")[side], data)
    wanted = None if meaning is None else Observation(("left", "right")[side], meaning)

    assert stopper.read(frame) == wanted
    assert stopper.read(replace(frame, is_extended=True)) is None
    assert stopper.read(replace(frame, is_remote=True)) is None


def test_cia_402_drives_are_stopped_by_taking_the_voltage_and_asked_by_sync() -> None:
    left, right = ids("cart-cia402")

    stop = stopper_of(hardware("cart-cia402")).stop()
    assert stop == [Frame(0x200 + left, bytes(4)), Frame(0x200 + right, bytes(4)), Frame(0x080, b"")]


@pytest.mark.parametrize("robot", ROBOTS)
def test_no_frame_at_all_makes_reading_fail(robot: str) -> None:
    stopper, chance = stopper_of(hardware(robot)), random.Random(1)  # noqa: S311 - noise, and the same every time
    standard = ((identifier, False) for identifier in range(2_048))
    extended = ((command << 8 | number, True) for command in range(64) for number in (0, *range(8), 255))
    for identifier, is_extended in (*standard, *extended):
        for length in range(9):
            heard = stopper.read(Frame(identifier, chance.randbytes(length), is_extended=is_extended))
            assert heard is None or heard.drive in stopper.drives
