# SPDX-License-Identifier: MIT
"""The codec against cantools on the DBC files, whose known errors are listed here."""

import math
import struct
from collections.abc import Sequence
from importlib.resources import as_file, files
from typing import Any

import cantools
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.frames import (
    LAYOUTS,
    Firmware,
    Message,
    decode,
    encode,
    request,
)
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame
from tests.fuzzing import fuzzed

FILES = {Firmware.V0_5: "odrive-cansimple-0.5.6.dbc", Firmware.V0_6: "odrive-cansimple-0.6.10.dbc"}


def load(firmware: Firmware) -> Any:
    with as_file(files("segway_ecc.firmware_io.drives.odrive") / FILES[firmware]) as path:
        return cantools.database.load_file(path)


DBC = {firmware: load(firmware) for firmware in Firmware}
TYPES: dict[str, type[Message]] = {
    "Get_Motor_Error": m.MotorError,
    "Get_Encoder_Error": m.EncoderError,
    "Get_Controller_Error": m.ControllerError,
    "Set_Axis_State": m.SetAxisState,
    "Get_Encoder_Estimates": m.EncoderEstimates,
    "Get_Encoder_Count": m.EncoderCount,
    "Set_Controller_Mode": m.SetControllerMode,
    "Set_Input_Pos": m.SetInputPosition,
    "Set_Input_Vel": m.SetInputVelocity,
    "Set_Input_Torque": m.SetInputTorque,
    "Set_Limits": m.SetLimits,
    "Get_Iq": m.Currents,
    "Get_Bus_Voltage_Current": m.BusVoltageCurrent,
    "Set_Linear_Count": m.SetLinearCount,
    "Get_Version": m.Version,
    "Estop": m.Estop,
    "Get_Error": m.Errors,
    "Get_Temperature": m.Temperatures,
    "Set_Absolute_Position": m.SetAbsolutePosition,
    "Get_Torques": m.Torques,
    "Get_Powers": m.Powers,
}
"""By name in both DBCs, less "Axis0_"."""
DIFFERENT: dict[tuple[Firmware, str], type[Message]] = {
    (Firmware.V0_5, "Heartbeat"): m.Heartbeat,
    (Firmware.V0_5, "Reboot"): m.Reboot,
    (Firmware.V0_5, "Clear_Errors"): m.ClearErrors,
    (Firmware.V0_6, "Heartbeat"): m.ProcedureHeartbeat,
    (Firmware.V0_6, "Reboot"): m.RebootAction,
    (Firmware.V0_6, "Clear_Errors"): m.ClearAxisErrors,
}
WRONG_SIGN = {(0x0A, "Shadow_Count"), (0x0A, "Count_in_CPR")}
"""The 0.5.6 DBC says unsigned, the firmware sends signed."""
WRONG_WIDTH = {0x03}
"""Get_Motor_Error of 0.5: 32 bits in the DBC, 64 in the firmware."""
WRONG_UNITS = {
    (Firmware.V0_5, "Set_Input_Vel", "Input_Vel"): "rev",
    (Firmware.V0_5, "Set_Input_Vel", "Input_Torque_FF"): "rev/s",
}
"""Which should be rev/s and Nm."""
LAYOUT_ONLY = {"Reserved", "Reserved0", "Reserved1", "Trajectory_Done_Flag"} | {
    f"{part}_Error_Flag" for part in ("Motor", "Encoder", "Controller")
}
"""What is not read, and sent as zero."""


def type_of(firmware: Firmware, name: str) -> type[Message]:
    return DIFFERENT.get((firmware, name)) or TYPES[name]


def _ours(firmware: Firmware, message: Any, values: dict[str, float]) -> Message:
    """The message that the DBC's raw values make."""
    name = message.name.split("_", 1)[1]
    kind: Any = type_of(firmware, name)
    ordered = [(s, values[s.name]) for s in sorted(message.signals, key=lambda s: s.start) if s.name not in LAYOUT_ONLY]
    fields: list[Any] = [value * s.scale if s.scale != 1 else value for s, value in ordered]
    command = message.frame_id % 32
    if firmware is Firmware.V0_5 and any((command, s.name) in WRONG_SIGN for s, _ in ordered):
        fields = [value - (1 << 32) if value >= 1 << 31 else value for value in fields]
    return kind(*fields)  # type: ignore[no-any-return]


def _theirs(message: Any, values: dict[str, float]) -> bytes:
    cleared = {name: 0 if name in LAYOUT_ONLY else value for name, value in values.items()}
    return bytes(message.encode(cleared, scaling=False, strict=False))


DBC_MESSAGES = [
    (firmware, message)
    for firmware in Firmware
    for message in DBC[firmware].messages
    if message.frame_id % 32 in LAYOUTS[firmware]
]
"""Those that are used here."""


@fuzzed
@given(st.integers(0, len(DBC_MESSAGES) - 1), st.binary(min_size=8, max_size=8))
def test_bytes_are_cantools_bytes_both_ways(index: int, data: bytes) -> None:
    firmware, message = DBC_MESSAGES[index]
    values = message.decode(data[: message.length], scaling=False, decode_choices=False)
    if not all(math.isfinite(value) for value in values.values()):
        _check_refused_or_missing(firmware, message.frame_id, data)
        return
    ours, theirs = _ours(firmware, message, values), _theirs(message, values)

    assert encode(firmware, message.frame_id // 32, ours) == Frame(message.frame_id, theirs)
    decoded = decode(firmware, message.frame_id, theirs)
    assert type(decoded) is type(ours)
    assert decoded == ours


def _check_refused_or_missing(firmware: Firmware, identifier: int, data: bytes) -> None:
    """What is not finite is refused, unless it says that there is no sensor."""
    try:
        message = decode(firmware, identifier, data)
    except FrameRefusedError:
        return
    assert type(message) is m.Temperatures
    assert None in message


@pytest.mark.parametrize("firmware", Firmware)
def test_the_comparison_reaches_every_message(firmware: Firmware) -> None:
    compared = {type_of(of, message.name.split("_", 1)[1]) for of, message in DBC_MESSAGES if of is firmware}
    ours = {layout.message for layout in LAYOUTS[firmware].values()}
    assert ours - compared == ({m.Estop} if firmware is Firmware.V0_5 else set())
    assert compared <= ours


def test_the_dbcs_known_errors_are_there() -> None:
    old = DBC[Firmware.V0_5]
    assert not [message for message in old.messages if message.name.endswith("Estop")]
    assert old.get_message_by_name("Axis0_Get_Motor_Error").get_signal_by_name("Motor_Error").length == 32
    assert {message.frame_id for message in old.messages if "Get_Motor_Error" in message.name} >= WRONG_WIDTH
    for command, name in WRONG_SIGN:
        assert not old.get_message_by_frame_id(command).get_signal_by_name(name).is_signed
    for (firmware, message, name), unit in WRONG_UNITS.items():
        assert DBC[firmware].get_message_by_name(f"Axis0_{message}").get_signal_by_name(name).unit == unit


def test_estop_and_the_wide_motor_error_are_as_in_the_firmware() -> None:
    assert encode(Firmware.V0_5, 3, m.Estop()) == Frame(0x062, b"")
    assert encode(Firmware.V0_6, 3, m.Estop()) == Frame(0x062, b"")
    wide = m.MotorError(0x0123_4567_89AB_CDEF)
    assert encode(Firmware.V0_5, 0, wide).data.hex() == "efcdab8967452301"
    assert decode(Firmware.V0_5, 0x003, bytes.fromhex("efcdab8967452301")) == wide


@pytest.mark.parametrize("firmware", Firmware)
@pytest.mark.parametrize(
    ("node", "message", "identifier", "data"),
    [
        (0, m.SetInputTorque(0.5), 0x00E, "0000003f00000000"),
        (0, m.SetInputVelocity(2.0, 0.1), 0x00D, "00000040cdcccc3d"),
        (0, m.SetAxisState(8), 0x007, "0800000000000000"),
        (0, m.SetInputPosition(1.5, 0.25, -0.1), 0x00C, "0000c03ffa009cff"),
        (1, m.EncoderEstimates(0.0, 0.0), 0x029, "0000000000000000"),
        (62, m.SetControllerMode(1, 1), 0x7CB, "0100000001000000"),
    ],
)
def test_golden_vectors(firmware: Firmware, node: int, message: Message, identifier: int, data: str) -> None:
    assert encode(firmware, node, message) == Frame(identifier, bytes.fromhex(data))


def test_heartbeats_differ_behind_the_state() -> None:
    data = bytes.fromhex("4008000008010181")
    assert decode(Firmware.V0_5, 0x021, data) == m.Heartbeat(0x840, 8)
    assert decode(Firmware.V0_6, 0x021, data) == m.ProcedureHeartbeat(0x840, 8, 1)


def test_the_same_command_means_other_things_to_the_other_firmware() -> None:
    data = struct.pack("<ff", 1.5, -2.5)
    assert decode(Firmware.V0_6, 0x01C, data) == m.Torques(1.5, -2.5)
    assert decode(Firmware.V0_6, 0x015, data) == m.Temperatures(1.5, -2.5)
    assert decode(Firmware.V0_5, 0x019, bytes.fromhex("ffffffff")) == m.SetLinearCount(-1)


def test_a_missing_sensor_has_no_temperature_and_an_infinite_one_is_refused() -> None:
    data = struct.pack("<ff", 31.5, math.nan)
    assert decode(Firmware.V0_6, 0x015, data) == m.Temperatures(31.5, None)
    back = encode(Firmware.V0_6, 0, m.Temperatures(None, 20.0)).data
    assert decode(Firmware.V0_6, 0x015, back) == m.Temperatures(None, 20.0)
    with pytest.raises(FrameRefusedError, match="0x015 refused: range"):
        decode(Firmware.V0_6, 0x015, struct.pack("<ff", math.inf, 20.0))


def test_the_host_may_be_brief_where_the_firmware_reads_no_more() -> None:
    assert decode(Firmware.V0_5, 0x007, bytes.fromhex("08000000")) == m.SetAxisState(8)
    assert decode(Firmware.V0_6, 0x00E, bytes.fromhex("0000003f")) == m.SetInputTorque(0.5)


def test_a_request_is_a_remote_frame_without_data() -> None:
    assert request(1, 0x09) == Frame(0x029, b"", is_remote=True)


def _lengths(firmware: Firmware, command: int) -> Sequence[int]:
    """Lengths that are taken, from the table of messages."""
    if command not in LAYOUTS[firmware]:
        return ()
    least = {
        0x02: 0, 0x07: 4, 0x0B: 8, 0x0C: 8, 0x0D: 8, 0x0E: 4, 0x0F: 8, 0x16: 0, 0x18: 0, 0x19: 4,
    }  # fmt: skip
    if firmware is Firmware.V0_6:
        least |= {0x16: 1, 0x18: 1}
    return range(least.get(command, 8), 9)


@pytest.mark.parametrize("firmware", Firmware)
def test_every_identifier_and_length_is_taken_or_refused_as_listed(firmware: Firmware) -> None:
    for identifier in range(2048):
        for length in range(10):
            if length in _lengths(firmware, identifier % 32):
                decode(firmware, identifier, bytes(length))
                continue
            with pytest.raises(FrameRefusedError) as refused:
                decode(firmware, identifier, bytes(length))
            known = identifier % 32 in LAYOUTS[firmware]
            assert refused.value.refusal is (Refusal.LENGTH if known else Refusal.UNKNOWN)


@fuzzed
@given(st.integers(0, 0x7FF), st.binary(min_size=5, max_size=9))
@example(0x009, struct.pack("<ff", math.nan, 0.0))
@example(0x01D, struct.pack("<ff", 0.0, -math.inf))
def test_arbitrary_bytes_are_refused_or_finite(identifier: int, data: bytes) -> None:
    for firmware in Firmware:
        try:
            message = decode(firmware, identifier, data)
        except FrameRefusedError:
            continue
        assert all(math.isfinite(value) for value in message if isinstance(value, int | float))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 3.5e38, -1e300])
@pytest.mark.parametrize(
    "make",
    [
        m.SetInputTorque,
        lambda bad: m.SetInputVelocity(0.0, bad),
        lambda bad: m.SetInputPosition(0.0, bad),
        lambda bad: m.EncoderEstimates(bad, 0.0),
        lambda bad: m.EncoderEstimates(0.0, bad),
    ],
)
def test_what_is_no_number_is_never_encoded(make: Any, bad: float) -> None:
    with pytest.raises(FrameRefusedError) as refused:
        encode(Firmware.V0_5, 0, make(bad))
    assert refused.value.refusal is Refusal.RANGE


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("identifier", [0x009, 0x014, 0x017, 0x00E])
def test_what_is_no_number_is_never_decoded(identifier: int, bad: float) -> None:
    for data in (struct.pack("<ff", bad, 0.0), struct.pack("<ff", 0.0, bad)):
        if identifier == 0x00E and not math.isfinite(struct.unpack("<ff", data)[1]):
            continue  # behind what Set_Input_Torque reads
        with pytest.raises(FrameRefusedError, match=f"frame 0x{identifier:03X} refused: range"):
            decode(Firmware.V0_5, identifier, data)


@pytest.mark.parametrize(
    ("firmware", "message"),
    [
        (Firmware.V0_5, m.Version(2, 4, 4, 58, 0, 6, 10, 0)),
        (Firmware.V0_5, m.ClearAxisErrors()),
        (Firmware.V0_6, m.ClearErrors()),
        (Firmware.V0_6, m.EncoderCount(0, 0)),
    ],
)
def test_a_message_of_the_other_firmware_is_refused(firmware: Firmware, message: Message) -> None:
    with pytest.raises(FrameRefusedError) as refused:
        encode(firmware, 0, message)
    assert refused.value.refusal is Refusal.UNKNOWN


@pytest.mark.parametrize("message", [m.SetAxisState(-1), m.SetInputPosition(0.0, 32.768), m.Heartbeat(1 << 32, 1)])
def test_what_does_not_fit_its_field_is_refused(message: Message) -> None:
    with pytest.raises(FrameRefusedError, match=f"{type(message).__name__} refused: range"):
        encode(Firmware.V0_5, 0, message)
