# SPDX-License-Identifier: MIT
import itertools
import math

import canopen.emcy
import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.cia402.frames import (
    DriveStatus,
    Emergency,
    NmtCommand,
    NmtState,
    Sdo,
    Service,
    TorqueCommand,
    is_answer,
    motor_angle,
    motor_velocity,
    nmt_frame,
    pack_heartbeat,
    rated_torque,
    unpack_heartbeat,
    unpack_supply,
)
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame
from tests.fuzzing import fuzzed

DECODERS = {
    "status": (DriveStatus.unpack, 8),
    "velocity": (lambda data: motor_velocity(data, 1.0 / 60.0), 4),
    "supply": (unpack_supply, 4),
    "emergency": (Emergency.unpack, 8),
    "heartbeat": (unpack_heartbeat, 1),
    "sdo": (Sdo.unpack, 8),
}


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        (TorqueCommand(0x0006, 0.0), "06000000"),
        (TorqueCommand(0x000F, 0.5), "0f00f401"),
        (TorqueCommand(0x000F, -0.25), "0f0006ff"),
        (TorqueCommand(0x0080, 32.767), "8000ff7f"),
        (TorqueCommand(0xFFFF, -32.768), "ffff0080"),
    ],
)
def test_a_command_is_controlword_and_torque_in_permille(command: TorqueCommand, expected: str) -> None:
    assert command.pack().hex() == expected


@pytest.mark.parametrize(
    "command",
    [
        TorqueCommand(0, 32.7676),
        TorqueCommand(0, -32.7686),
        TorqueCommand(0, float("nan")),
        TorqueCommand(0, float("inf")),
        TorqueCommand(0, -float("inf")),
        TorqueCommand(-1, 0.0),
        TorqueCommand(0x10000, 0.0),
    ],
)
def test_what_does_not_fit_a_command_is_refused(command: TorqueCommand) -> None:
    with pytest.raises(FrameRefusedError, match="a command refused: range") as refused:
        command.pack()
    assert refused.value.refusal is Refusal.RANGE


@fuzzed
@given(st.floats())
def test_a_torque_is_packed_or_refused(share: float) -> None:
    try:
        data = TorqueCommand(0x000F, share).pack()
    except FrameRefusedError:
        assert not abs(share) <= 32.767
    else:
        assert data[:2] == b"\x0f\0"
        assert int.from_bytes(data[2:], "little", signed=True) == pytest.approx(share * 1000, abs=0.500001)


@fuzzed
@given(st.binary(min_size=8, max_size=8))
def test_every_field_is_at_its_documented_position(data: bytes) -> None:
    def number(start: int, end: int, *, signed: bool = False) -> int:
        return int.from_bytes(data[start:end], "little", signed=signed)

    status = DriveStatus.unpack(data)
    assert (status.statusword, status.position_counts) == (number(0, 2), number(2, 6, signed=True))
    assert status.torque_share == pytest.approx(number(6, 8, signed=True) / 1000)
    assert motor_velocity(data[:4], 1.0 / 60.0) == pytest.approx(number(0, 4, signed=True) * 2.0 * math.pi / 60.0)
    assert unpack_supply(data[:4]) == pytest.approx(number(0, 4) / 1000)
    assert tuple(Emergency.unpack(data)) == canopen.emcy.EMCY_STRUCT.unpack(data)
    assert Emergency.unpack(data).pack() == data
    sdo = Sdo.unpack(data)
    assert tuple(sdo) == (data[0], number(1, 3), data[3], data[4:])
    assert sdo.pack() == data


@fuzzed
@given(st.binary(max_size=9))
def test_a_decoder_gives_values_or_its_one_error(data: bytes) -> None:
    for decoder, length in DECODERS.values():
        try:
            decoder(data)
        except FrameRefusedError as error:
            is_length = error.refusal is Refusal.LENGTH
        else:
            is_length = False
            assert len(data) == length
        assert is_length == (len(data) != length)


@pytest.mark.parametrize(
    ("code", "name"),
    [
        (0x0000, "no error"),
        (0x1000, "generic"),
        (0x2310, "current"),
        (0x3210, "voltage"),
        (0x4210, "temperature"),
        (0x5080, "hardware of the drive"),
        (0x6100, "software of the drive"),
        (0x7305, "sensor"),
        (0x7100, "additional modules"),
        (0x8110, "CAN overrun"),
        (0x8120, "CAN error passive"),
        (0x8130, "heartbeat of the host missed"),
        (0x8140, "recovered from bus-off"),
        (0x8150, "communication"),
        (0x8210, "protocol"),
        (0x8611, "monitoring"),
        (0x9000, "external"),
        (0xF001, "additional functions"),
        (0xFF01, "of the manufacturer"),
        (0xA000, "reserved"),
    ],
)
def test_emergencies_are_named_by_their_class(code: int, name: str) -> None:
    assert Emergency(code, 0).description == f"EMCY 0x{code:04X} ({name})"


@pytest.mark.parametrize(
    ("state", "byte"), [("STOPPED", 4), ("OPERATIONAL", 5), ("PRE_OPERATIONAL", 127), ("BOOT_UP", 0)]
)
def test_heartbeats_are_one_byte(state: str, byte: int) -> None:
    assert pack_heartbeat(NmtState[state]) == bytes((byte,))
    assert unpack_heartbeat(bytes((byte,))) is NmtState[state]


def test_no_other_byte_is_a_heartbeat() -> None:
    known = []
    for byte in range(256):
        try:
            known.append(int(unpack_heartbeat(bytes((byte,)))))
        except FrameRefusedError as error:
            assert error.refusal is Refusal.RANGE  # noqa: PT017 - most bytes must raise, four must not
    assert known == [0, 4, 5, 127]


@pytest.mark.parametrize(
    ("command", "byte"),
    [("START", 1), ("STOP", 2), ("PRE_OPERATIONAL", 128), ("RESET_NODE", 129), ("RESET_COMMUNICATION", 130)],
)
def test_an_nmt_frame_is_command_and_node(command: str, byte: int) -> None:
    assert nmt_frame(NmtCommand[command], 5) == Frame(0x000, bytes((byte, 5)))


READ = bytes((0x40, 0x18, 0x10, 1, 0, 0, 0, 0))
ANSWERS = {
    "the same object": (READ, bytes((0x43, 0x18, 0x10, 1, 9, 9, 9, 9)), True),
    "another object": (READ, bytes((0x43, 0x18, 0x10, 2, 9, 9, 9, 9)), False),
    "an abort that bears none": (READ, bytes((0x80, 0, 0, 0, 9, 9, 9, 9)), True),
    "an abort of another": (READ, bytes((0x80, 0x18, 0x10, 2, 9, 9, 9, 9)), False),
    "a segment, which bears none": (bytes((0x60, *bytes(7))), bytes((0x01, *b"a drive")), True),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_an_answer_bears_the_object_that_was_asked_for(name: str) -> None:
    request, answer, is_one = ANSWERS[name]
    assert is_answer(request, answer) is is_one


def test_identifiers_are_those_of_the_predefined_connection_set() -> None:
    assert [int(service) for service in Service] == [
        0x000, 0x080, 0x180, 0x200, 0x280, 0x380, 0x480, 0x580, 0x600, 0x700,
    ]  # fmt: skip
    assert all(a + 127 < b for a, b in itertools.pairwise(sorted(service for service in Service if service > 0x180)))


def test_positions_and_rated_torque_are_converted_to_si() -> None:
    assert motor_angle(-1024, 4096) == pytest.approx(-math.pi / 2.0)
    assert rated_torque(1_250) == pytest.approx(1.25)


@pytest.mark.parametrize("rated", [None, 0.0])
def test_torque_of_a_motor_with_unknown_rated_torque_is_zero(rated: float | None) -> None:
    assert TorqueCommand.of(0x000F, 1.0, rated) == TorqueCommand(0x000F, 0.0)


def test_torques_are_shares_of_the_rated_torque() -> None:
    assert TorqueCommand.of(0x000F, 0.5, 2.0) == TorqueCommand(0x000F, 0.25)
    assert DriveStatus(0, 0, 0.25).motor_torque(2.0) == pytest.approx(0.5)
