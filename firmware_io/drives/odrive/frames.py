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

from segway_ecc.firmware_io.devices import TURN
from segway_ecc.firmware_io.drives.odrive import messages as m
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

Message = tuple[Any, ...]
"""One of the classes of `messages`."""


@enum.unique
class Firmware(enum.StrEnum):
    """The firmwares that differ on the bus: 0.5 is ODrive v3's, 0.6 that of Pro, S1 and Micro."""

    V0_5 = "0.5"
    V0_6 = "0.6"


class _FrameLayout(NamedTuple):
    """How a message lies in a frame of `lengths` bytes; what is not finite is found before and after, not by these."""

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


def _pack_input_position(p: m.SetInputPosition) -> bytes:
    feedforwards = (round(p.velocity_rev_s / _FEEDFORWARD), round(p.torque_nm / _FEEDFORWARD))
    return struct.pack("<fhh", p.position_rev, *feedforwards)


def _unpack_input_position(data: bytes) -> m.SetInputPosition:
    position, velocity, torque = struct.unpack("<fhh", data)
    return m.SetInputPosition(position, velocity * _FEEDFORWARD, torque * _FEEDFORWARD)


def _unpack_temperatures(data: bytes) -> m.Temperatures:
    # The drive sends NaN for a sensor that it does not have.
    first, second = (None if math.isnan(value) else value for value in struct.unpack("<ff", data))
    return m.Temperatures(first, second)


_BOTH: Final[Mapping[int, _FrameLayout]] = {
    0x02: _asked(m.Estop, length=0),
    0x07: _asked(m.SetAxisState, "I"),
    ESTIMATES: _sent(m.EncoderEstimates, "ff"),
    0x0B: _asked(m.SetControllerMode, "II"),
    0x0C: _FrameLayout(m.SetInputPosition, range(_FULL, _FULL + 1), _pack_input_position, _unpack_input_position),
    0x0D: _asked(m.SetInputVelocity, "ff"),
    0x0E: _asked(m.SetInputTorque, "f"),
    0x0F: _asked(m.SetLimits, "ff"),
    0x14: _sent(m.Currents, "ff"),
    0x17: _sent(m.BusVoltageCurrent, "ff"),
}
LAYOUTS: Final[Mapping[Firmware, Mapping[int, _FrameLayout]]] = {
    Firmware.V0_5: {
        **_BOTH,
        HEARTBEAT: _sent(m.Heartbeat, "IB"),
        0x03: _sent(m.MotorError, "Q"),
        0x04: _sent(m.EncoderError, "I"),
        0x0A: _sent(m.EncoderCount, "ii"),
        0x16: _asked(m.Reboot, length=0),
        0x18: _asked(m.ClearErrors, length=0),
        0x19: _asked(m.SetLinearCount, "i"),
        0x1D: _sent(m.ControllerError, "I"),
    },
    Firmware.V0_6: {
        **_BOTH,
        VERSION: _sent(m.Version, "8B"),
        HEARTBEAT: _sent(m.ProcedureHeartbeat, "IBB"),
        0x03: _sent(m.Errors, "II"),
        0x15: _sent(m.Temperatures, "ff")._replace(
            pack=lambda values: struct.pack("<ff", *(math.nan if value is None else value for value in values)),
            unpack=_unpack_temperatures,
        ),
        0x16: _asked(m.RebootAction, "B", length=1),
        0x18: _asked(m.ClearAxisErrors, "B", length=1),
        0x19: _asked(m.SetAbsolutePosition, "f"),
        0x1C: _sent(m.Torques, "ff"),
        0x1D: _sent(m.Powers, "ff"),
    },
}
"""Every frame that is used here, by its command."""
COMMANDING: Final = frozenset({0x02, 0x07, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F, 0x16, 0x18, 0x19})
"""Those that a host sends, in one firmware or the other; an axis sends the rest."""
_COMMAND_OF: Final = {
    firmware: {layout.message: command for command, layout in layouts.items()} for firmware, layouts in LAYOUTS.items()
}

AXIS_ERRORS: Final[Mapping[Firmware, Mapping[int, str]]] = {
    Firmware.V0_5: {
        0x1: "INVALID_STATE",
        0x40: "MOTOR_FAILED",
        0x80: "SENSORLESS_ESTIMATOR_FAILED",
        0x100: "ENCODER_FAILED",
        0x200: "CONTROLLER_FAILED",
        0x800: "WATCHDOG_TIMER_EXPIRED",
        0x1000: "MIN_ENDSTOP_PRESSED",
        0x2000: "MAX_ENDSTOP_PRESSED",
        0x4000: "ESTOP_REQUESTED",
        0x20000: "HOMING_WITHOUT_ENDSTOP",
        0x40000: "OVER_TEMP",
        0x80000: "UNKNOWN_POSITION",
    },
    Firmware.V0_6: {
        0x1: "INITIALIZING",
        0x2: "SYSTEM_LEVEL",
        0x4: "TIMING_ERROR",
        0x8: "MISSING_ESTIMATE",
        0x10: "BAD_CONFIG",
        0x20: "DRV_FAULT",
        0x40: "MISSING_INPUT",
        0x100: "DC_BUS_OVER_VOLTAGE",
        0x200: "DC_BUS_UNDER_VOLTAGE",
        0x400: "DC_BUS_OVER_CURRENT",
        0x800: "DC_BUS_OVER_REGEN_CURRENT",
        0x1000: "CURRENT_LIMIT_VIOLATION",
        0x2000: "MOTOR_OVER_TEMP",
        0x4000: "INVERTER_OVER_TEMP",
        0x8000: "VELOCITY_LIMIT_VIOLATION",
        0x10000: "POSITION_LIMIT_VIOLATION",
        0x1000000: "WATCHDOG_TIMER_EXPIRED",
        0x2000000: "ESTOP_REQUESTED",
        0x4000000: "SPINOUT_DETECTED",
        0x8000000: "BRAKE_RESISTOR_DISARMED",
        0x10000000: "THERMISTOR_DISCONNECTED",
        0x40000000: "CALIBRATION_ERROR",
    },
}
"""Names by bit, as in `Axis.Error` of the ODrive v3 firmware 0.5.6, and in the DBC of 0.6.10."""
WATCHDOG: Final[Mapping[Firmware, int]] = {Firmware.V0_5: 0x800, Firmware.V0_6: 0x1000000}
"""The bit that the watchdog expired."""


def motor_motion(estimates: m.EncoderEstimates) -> tuple[float, float]:
    """Angle, rad, and velocity, rad/s, of the motor."""
    return estimates.position_rev * TURN, estimates.velocity_rev_s * TURN


def angle_resolution(estimates: m.EncoderEstimates) -> float:
    """Step of the motor's angle, rad, on the wire: of a float of 24 bits instead of Python's 53."""
    return math.ulp(max(1.0, abs(estimates.position_rev))) * (1 << 29) * TURN


def arbitration_id(node_id: int, command: int) -> int:
    """The identifier of a node's command."""
    return node_id * COMMANDS + command


def request(node_id: int, command: int) -> Frame:
    """The remote frame that asks a node for what a command carries."""
    return Frame(arbitration_id(node_id, command), b"", is_remote=True)


def encode(firmware: Firmware, node_id: int, message: Message) -> Frame:
    """The frame that carries a message; FrameRefusedError where the firmware lacks it, or a value does not fit."""
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
    """The message in a frame, whichever node it belongs to; its command has the meaning that it has in `firmware`.

    Raises:
        FrameRefusedError: A command that firmware does not have, a wrong length, or a number that is not finite.
    """
    layout = LAYOUTS[firmware].get(identifier % COMMANDS)
    if layout is None:
        raise FrameRefusedError(Refusal.UNKNOWN, _name(identifier))
    if len(data) not in layout.lengths:
        raise FrameRefusedError(Refusal.LENGTH, _name(identifier))
    message = layout.unpack(data)
    if not _is_finite(message):
        raise FrameRefusedError(Refusal.RANGE, _name(identifier))
    return message


def _name(identifier: int) -> str:
    return f"frame 0x{identifier:03X}"


def _is_finite(message: tuple[object, ...]) -> bool:
    for value in message:  # noqa: SIM110 - a generator in all() takes three times as long
        if isinstance(value, float) and not math.isfinite(value):
            return False
    return True


def error_names(firmware: Firmware, errors: int) -> tuple[str, ...]:
    """The names of the bits that are set, lowest first; a bit without a name is given as a number."""
    return named_bits(AXIS_ERRORS[firmware], errors)


def named_bits(names: Mapping[int, str], errors: int) -> tuple[str, ...]:
    """The names of the bits that are set, by a table of them; see `error_names`."""
    bits = (1 << index for index in range(errors.bit_length()) if errors >> index & 1)
    return tuple(names.get(bit, f"0x{bit:X}") for bit in bits)
