# SPDX-License-Identifier: MIT
"""ODrive's CANSimple frames: bytes to messages and back, for firmware 0.5 and 0.6.

An 11-bit identifier is the node's number and a command of five bits; the same command can mean different things to the
two firmwares, so every codec is given the firmware. All fields are little-endian. There is no counter and no checksum.
"""

import enum
import functools
import math
import struct
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from segway_ecc.firmware_io.drives.odrive import commands as c
from segway_ecc.firmware_io.drives.odrive import telemetry as t
from segway_ecc.firmware_io.drivetrain import TURN
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame

COMMANDS: Final = 32
"""Commands that an identifier can carry."""
VERSION: Final = 0x00
HEARTBEAT: Final = 0x01
ESTIMATES: Final = 0x09
"""Commands whose frames both firmwares have, or that identify the firmware."""
_FULL: Final = 8
_FEEDFORWARD: Final = 0.001
"""rev/s and N m; 0.6 can be configured otherwise, which is not supported."""
_SDO: Final = struct.Struct("<BHx")
_ADDRESS: Final = struct.Struct("<BIH")
_NAN: Final = math.nan

Message = tuple[Any, ...]
"""One of the classes of `commands` and `telemetry`."""


@enum.unique
class Firmware(enum.StrEnum):
    """The firmwares that differ on the bus: 0.5 is ODrive v3's, 0.6 that of Pro, S1 and Micro."""

    V0_5 = "0.5"
    V0_6 = "0.6"


class _FrameLayout(NamedTuple):
    """How one message lies in its frame.

    Attributes:
        message: Its class.
        lengths: Lengths in bytes that are taken.
        pack: A message to bytes, checked already for what is not finite.
        unpack: Bytes of a length that is taken to a message; what is not finite is found afterwards.
    """

    message: type[Any]
    lengths: range
    pack: Callable[[Any], bytes]
    unpack: Callable[[bytes], Message]


def _asked(message: type[Any], form: str = "", length: int = _FULL, least: int | None = None) -> _FrameLayout:
    """A frame of the host, as its fields stand, sent with `length` bytes; the axis needs no more than the fields."""
    body = struct.Struct(f"<{form}")
    return _FrameLayout(
        message,
        range(body.size if least is None else least, _FULL + 1),
        lambda values: body.pack(*values).ljust(length, b"\0"),
        lambda data: message(*body.unpack_from(data)),
    )


_sent: Final = functools.partial(_asked, least=_FULL)
"""A frame of the axis, as its fields stand; always eight bytes."""


def _pack_heartbeat(h: t.Heartbeat) -> bytes:
    last = h.controller_error | h.trajectory_done << 7
    return struct.pack("<IBBBB", h.axis_error, h.state, h.motor_error, h.encoder_error, last)


def _unpack_heartbeat(data: bytes) -> t.Heartbeat:
    error, state, motor, encoder, last = struct.unpack("<IBBBB", data)
    return t.Heartbeat(error, state, bool(motor & 1), bool(encoder & 1), bool(last & 1), bool(last >> 7))


def _unpack_procedure_heartbeat(data: bytes) -> t.ProcedureHeartbeat:
    error, state, result, flags = struct.unpack("<IBBBx", data)
    return t.ProcedureHeartbeat(error, state, result, bool(flags & 1))


def _pack_input_position(p: c.SetInputPosition) -> bytes:
    feedforwards = (round(p.velocity_rev_s / _FEEDFORWARD), round(p.torque_nm / _FEEDFORWARD))
    return struct.pack("<fhh", p.position_rev, *feedforwards)


def _unpack_input_position(data: bytes) -> c.SetInputPosition:
    position, velocity, torque = struct.unpack("<fhh", data)
    return c.SetInputPosition(position, velocity * _FEEDFORWARD, torque * _FEEDFORWARD)


def _unpack_temperatures(data: bytes) -> t.Temperatures:
    # The drive sends NaN for a sensor that it does not have.
    first, second = (None if math.isnan(value) else value for value in struct.unpack("<ff", data))
    return t.Temperatures(first, second)


def _pack_sdo(opcode: int, endpoint: int, value: bytes) -> bytes:
    if len(value) > _FULL - _SDO.size:
        raise OverflowError
    return _SDO.pack(opcode, endpoint) + value


def _unpack_rx_sdo(data: bytes) -> c.RxSdo:
    opcode, endpoint = _SDO.unpack_from(data)
    return c.RxSdo(opcode, endpoint, data[_SDO.size :])


def _pack_address(address: c.Address) -> bytes:
    node_id, serial, connection = address
    body = _ADDRESS.pack(node_id, serial & 0xFFFFFFFF, serial >> 32)
    return body if connection is None else body + struct.pack("B", connection)


def _unpack_address(data: bytes) -> c.Address:
    node_id, low, high = _ADDRESS.unpack_from(data)
    return c.Address(node_id, low | high << 32, data[_ADDRESS.size] if len(data) > _ADDRESS.size else None)


_BOTH: Final[Mapping[int, _FrameLayout]] = {
    0x02: _asked(c.Estop, length=0),
    0x07: _asked(c.SetAxisState, "I"),
    ESTIMATES: _sent(t.EncoderEstimates, "ff"),
    0x0B: _asked(c.SetControllerMode, "II"),
    0x0C: _FrameLayout(c.SetInputPosition, range(_FULL, _FULL + 1), _pack_input_position, _unpack_input_position),
    0x0D: _asked(c.SetInputVelocity, "ff"),
    0x0E: _asked(c.SetInputTorque, "f"),
    0x0F: _asked(c.SetLimits, "ff"),
    0x11: _asked(c.SetTrajectoryVelocityLimit, "f"),
    0x12: _asked(c.SetTrajectoryAccelerationLimits, "ff"),
    0x13: _asked(c.SetTrajectoryInertia, "f"),
    0x14: _sent(t.Currents, "ff"),
    0x17: _sent(t.BusVoltageCurrent, "ff"),
    0x1A: _asked(c.SetPositionGain, "f"),
    0x1B: _asked(c.SetVelocityGains, "ff"),
}
LAYOUTS: Final[Mapping[Firmware, Mapping[int, _FrameLayout]]] = {
    Firmware.V0_5: {
        **_BOTH,
        HEARTBEAT: _FrameLayout(t.Heartbeat, range(_FULL, _FULL + 1), _pack_heartbeat, _unpack_heartbeat),
        0x03: _sent(t.MotorError, "Q"),
        0x04: _sent(t.EncoderError, "I"),
        0x05: _sent(t.SensorlessError, "I"),
        0x06: _asked(c.SetAxisNodeId, "I"),
        0x0A: _sent(t.EncoderCount, "ii"),
        0x10: _asked(c.StartAnticogging, length=0),
        0x15: _sent(t.SensorlessEstimates, "ff"),
        0x16: _asked(c.Reboot, length=0),
        0x18: _asked(c.ClearErrors, length=0),
        0x19: _asked(c.SetLinearCount, "i"),
        0x1C: _sent(t.AdcVoltage, "f"),
        0x1D: _sent(t.ControllerError, "I"),
    },
    Firmware.V0_6: {
        **_BOTH,
        VERSION: _sent(t.Version, "8B"),
        HEARTBEAT: _sent(t.ProcedureHeartbeat, "IBBB")._replace(unpack=_unpack_procedure_heartbeat),
        0x03: _sent(t.Errors, "II"),
        0x04: _FrameLayout(c.RxSdo, range(_SDO.size, _FULL + 1), lambda m: _pack_sdo(*m), _unpack_rx_sdo),
        0x05: _FrameLayout(
            t.TxSdo,
            range(_SDO.size, _FULL + 1),
            lambda m: _pack_sdo(0, *m),
            lambda data: t.TxSdo(*_unpack_rx_sdo(data)[1:]),
        ),
        0x06: _FrameLayout(c.Address, range(_ADDRESS.size, _FULL + 1), _pack_address, _unpack_address),
        0x15: _sent(t.Temperatures, "ff")._replace(
            pack=lambda m: struct.pack("<ff", *(_NAN if value is None else value for value in m)),
            unpack=_unpack_temperatures,
        ),
        0x16: _asked(c.RebootAction, "B", length=1),
        0x18: _asked(c.ClearAxisErrors, "B", length=1),
        0x19: _asked(c.SetAbsolutePosition, "f"),
        0x1C: _sent(t.Torques, "ff"),
        0x1D: _sent(t.Powers, "ff"),
        0x1F: _asked(c.EnterDfuMode, length=0),
    },
}
"""Every frame by its command."""
_COMMAND_OF: Final = {
    firmware: {layout.message: command for command, layout in layouts.items()} for firmware, layouts in LAYOUTS.items()
}


def motor_motion(estimates: t.EncoderEstimates) -> tuple[float, float]:
    """Angle, rad, and velocity, rad/s, of the motor."""
    return estimates.position_rev * TURN, estimates.velocity_rev_s * TURN


def angle_resolution(estimates: t.EncoderEstimates) -> float:
    """Step of the motor's angle, rad, on the wire: of a float of 24 bits instead of Python's 53."""
    return math.ulp(max(1.0, abs(estimates.position_rev))) * (1 << 29) * TURN


def command_of(firmware: Firmware, message: type[Any]) -> int:
    """The command that carries a type of message; KeyError where that firmware has none."""
    return _COMMAND_OF[firmware][message]


def arbitration_id(node_id: int, command: int) -> int:
    """The identifier of a node's command."""
    return node_id * COMMANDS + command


def request(node_id: int, command: int) -> Frame:
    """The remote frame that asks a node for what a command carries."""
    return Frame(arbitration_id(node_id, command), b"", is_remote=True)


def encode(firmware: Firmware, node_id: int, message: Message) -> Frame:
    """The frame that carries a message to or from a node.

    Raises:
        FrameRefusedError: That firmware has no such message, or a value is not finite or does not fit its field.
    """
    name = type(message).__name__
    command = _COMMAND_OF[firmware].get(type(message))
    if command is None:
        raise FrameRefusedError(Refusal.UNKNOWN, name)
    if not _is_finite(message):
        raise FrameRefusedError(Refusal.RANGE, name)
    try:
        data = LAYOUTS[firmware][command].pack(message)
    except (struct.error, OverflowError) as error:
        raise FrameRefusedError(Refusal.RANGE, name) from error
    return Frame(arbitration_id(node_id, command), data)


def decode(firmware: Firmware, identifier: int, data: bytes) -> Message:
    """The message in a frame, whichever node it belongs to.

    Args:
        firmware: Whose meaning its command has.
        identifier: The frame's 11-bit identifier.
        data: Its bytes.

    Raises:
        FrameRefusedError: A command that firmware does not have, a wrong length, or a number that is not finite.
    """
    what = f"frame 0x{identifier:03X}"
    layout = LAYOUTS[firmware].get(identifier % COMMANDS)
    if layout is None:
        raise FrameRefusedError(Refusal.UNKNOWN, what)
    if len(data) not in layout.lengths:
        raise FrameRefusedError(Refusal.LENGTH, what)
    message = layout.unpack(data)
    if not _is_finite(message):
        raise FrameRefusedError(Refusal.RANGE, what)
    return message


def _is_finite(message: tuple[object, ...]) -> bool:
    return all(math.isfinite(value) for value in message if isinstance(value, float))
