# SPDX-License-Identifier: MIT
"""The register protocol of moteus controllers, frame by frame.

Sources: docs/protocol/can.md and registers.md of github.com/mjbots/moteus (register map 5), and multiplex/format.h of
github.com/mjbots/mjlib, both of 2026. Little-endian; turns, turns/s, N m and s at the output shaft.
"""

import math
import struct
from typing import Final, NamedTuple

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame, fd_length

HOST, ASIDE, BROADCAST = 0, 126, 127
"""Under which identifiers this computer asks once a cycle, and beside that; and what all controllers obey."""
_STANDARD: Final = 0x7FF  # beyond it a frame is an extended one; up to it, controllers take either kind
MODES: Final = (
    *("stopped", "fault", "enabling", "calibrating", "calibration complete", "PWM", "voltage", "voltage FOC"),
    *("voltage DQ", "current", "position", "timeout", "zero velocity", "stay within", "measure inductance", "brake"),
)
"""By their numbers in register 0x000."""
STOPPED, FAULT, POSITION, TIMEOUT = 0, 1, 10, 11
OFF: Final = frozenset((0, 1, 2, 3, 4, TIMEOUT))
"""Those without torque (torque_on in fw/bldc_servo_control.h); of TIMEOUT that is so where servo.timeout_mode is 0."""
_FAULTS: Final = (
    *("calibration", "motor driver", "over-voltage", "encoder", "motor not configured", "PWM cycle overrun"),
    *("over-temperature", "outside servopos limits", "under-voltage", "configuration changed"),
    *("commutation encoder invalid", "position encoder invalid", "driver not enabled", "stop position deprecated"),
    *("timing violation", "bemf_feedforward without acceleration limit", "servopos limits invalid"),
)
_FIRST_FAULT: Final = 32  # what the first of them is in register 0x00f
STOP: Final = b"\x01\x00\x00"
_TORQUE: Final = b"\x01\x00\x0a\x0c\x06\x20"
_TIMEOUT: Final = b"\x0d\x27"
"""Write an int8 to 0x000; six floats from 0x020 on: position, velocity, torque, kp, kd, most torque; one to 0x027."""
_QUERY: Final = b"\x11\x00\x1f\x01\x1d\x0d\x12\x0e\x15\x27"
"""Read the mode as int8, motion and supply as float, temperature and fault as int8, the time-out as int16."""
_REPLY: Final = struct.Struct("<2sb2s3f2sf2s2b2shs")
_REPLY_HEADS: Final = (b"\x21\x00", b"\x2f\x01", b"\x2d\x0d", b"\x22\x0e", b"\x25\x27", b"\x50")
TEXT: Final = b"\x41\x01"
POLL_TEXT: Final = b"\x42\x01\x30"
"""Asks for up to 48 bytes of what the diagnostic console, channel 1, has written."""


class Reply(NamedTuple):
    """What a controller answers: turns, turns/s, N m, V, degrees Celsius, register 0x00f, and its time-out, s."""

    mode: int
    position: float
    velocity: float
    torque: float
    voltage: float
    temperature: float
    fault: int
    timeout_s: float


NOTHING: Final = Reply(STOPPED, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0)


def fault_name(code: int) -> str:
    """What register 0x00f means."""
    place = code - _FIRST_FAULT
    return f"{_FAULTS[place]} (fault {code})" if 0 <= place < len(_FAULTS) else f"fault {code}"


def route(source: int, destination: int, *, wants_reply: bool = False) -> FrameKey:
    """The identifier of what one sends to another."""
    identifier = wants_reply << 15 | source << 8 | destination
    return FrameKey(identifier, identifier > _STANDARD)


def frame_to(key: FrameKey, data: bytes) -> Frame:
    """The frame that carries sub-frames, filled up with what means nothing."""
    return Frame(key.arbitration_id, data.ljust(fd_length(len(data)), b"\x50"), is_extended=key.is_extended, is_fd=True)


def torque_command(torque: float, max_torque: float, timeout_s: float) -> bytes:
    """Torque alone, N m: position mode without a position and without its gains; it holds for so long, s."""
    floats = struct.pack("<6f", math.nan, 0.0, torque + 0.0, 0.0, 0.0, max_torque)  # never -0.0
    return _TORQUE + floats + _TIMEOUT + struct.pack("<f", timeout_s) + _QUERY


def is_zero(data: bytes) -> bool:
    """Whether sub-frames are those of a torque command of zero, of whatever largest torque and time-out."""
    return data.startswith(torque_command(0.0, 0.0, 0.0)[: len(_TORQUE) + 5 * 4])


def stop_command(timeout_s: float) -> bytes:
    """Stopped; the time-out has no effect, and can be read back."""
    return STOP + _TIMEOUT + struct.pack("<f", timeout_s) + _QUERY


def decode_reply(frame: Frame) -> Reply:
    """The answer to the query in a command; FrameRefusedError for any other, and for a value that is not finite."""
    if not frame.is_fd or len(frame.data) != _REPLY.size:
        raise FrameRefusedError(Refusal.LENGTH, f"answer of {len(frame.data)} bytes")
    fields = _REPLY.unpack(frame.data)
    if tuple(field for field in fields if isinstance(field, bytes)) != _REPLY_HEADS:
        raise FrameRefusedError(Refusal.UNKNOWN, "answer")
    mode, *measured, temperature, fault, timeout_raw = (field for field in fields if not isinstance(field, bytes))
    if not 0 <= mode < len(MODES) or not all(map(math.isfinite, measured)):
        raise FrameRefusedError(Refusal.RANGE, "answer")
    return Reply._make((mode, *measured, temperature, fault, timeout_raw * 1e-3))


def console_line(text: str) -> bytes:
    """A line for the diagnostic console."""
    return bytes((0x40, 0x01, len(text) + 1)) + text.encode() + b"\n"


def decode_text(frame: Frame) -> bytes:
    """What the diagnostic console has written; FrameRefusedError for another answer."""
    length, text = frame.data[2:3], frame.data[3:]
    if not frame.is_fd or frame.data[:2] != TEXT or len(text) < (length or b"\xff")[0]:
        raise FrameRefusedError(Refusal.UNKNOWN, "answer")
    return text[: length[0]]
