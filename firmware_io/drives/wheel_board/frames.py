"""The wheel board's frames: bytes to SI and back, as wheel_board.dbc describes them."""

import enum
import struct
from typing import Final, Self

import msgspec

from firmware_io.integrity import FrameRefusedError, Refusal, frame_crc

MAX_VOLTAGE: Final = 30.0
MAX_ANGLE: Final = 200_000.0
MAX_VELOCITY: Final = 320.0
MAX_BUS_VOLTAGE: Final = 60.0
MAX_TURN_RATE: Final = 32.0
MAX_ACCELERATION: Final = 160.0
MIN_WATCHDOG_S: Final = 0.02
MAX_WATCHDOG_S: Final = 1.0

_VOLT: Final = 0.001
_RADIAN: Final = 0.0001
_RADIAN_PER_SECOND: Final = 0.01
_SECOND: Final = 0.001
_MILLIRADIAN_PER_SECOND: Final = 0.001
_METRE_PER_SECOND_SQUARED: Final = 0.005

# Bodies of seven bytes, the counter last; the CRC follows as the eighth.
_COMMAND: Final = struct.Struct("<hhBxB")
_SETUP: Final = struct.Struct("<HxxxxB")
_WHEEL: Final = struct.Struct("<ihB")
_STATUS: Final = struct.Struct("<BHHBB")
_AXES: Final = struct.Struct("<hhhB")
_LENGTH: Final = 8
_BODY: Final = 7
_COUNTER_MASK: Final = 0x0F


@enum.unique
class FrameId(enum.IntEnum):
    """Arbitration ids; a lower one wins the bus, so commands win over telemetry."""

    WHEEL_COMMAND = 0x110
    BOARD_SETUP = 0x111
    LEFT_WHEEL = 0x120
    RIGHT_WHEEL = 0x121
    IMU_GYRO = 0x122
    IMU_ACCELERATION = 0x123
    BOARD_STATUS = 0x130


CYCLE_TIME_S: Final = {
    FrameId.WHEEL_COMMAND: 0.010,
    FrameId.LEFT_WHEEL: 0.005,
    FrameId.RIGHT_WHEEL: 0.005,
    FrameId.IMU_GYRO: 0.005,
    FrameId.IMU_ACCELERATION: 0.005,
    FrameId.BOARD_STATUS: 0.020,
}
"""How often each cyclic frame is sent."""


@enum.unique
class BoardState(enum.IntEnum):
    """What the board is doing."""

    DISABLED = 0
    ENABLED = 1
    WATCHDOG = 2
    """Motors off because commands stopped; left by a command that does not enable."""
    FAULT = 3
    """Motors off because the board found something wrong; lasts as long as the cause."""


class WheelCommand(msgspec.Struct, frozen=True, gc=False):
    """Motor voltages, V, within +-30; `enable` False switches the motors off."""

    left_voltage: float
    right_voltage: float
    enable: bool

    def in_range(self) -> bool:
        """Whether every value is finite and within the DBC's range."""
        return abs(self.left_voltage) <= MAX_VOLTAGE and abs(self.right_voltage) <= MAX_VOLTAGE

    def pack(self, counter: int) -> bytes:
        """The first seven bytes of the frame."""
        return _COMMAND.pack(round(self.left_voltage / _VOLT), round(self.right_voltage / _VOLT), self.enable, counter)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """From the first seven bytes of the frame."""
        left, right, flags, _ = _COMMAND.unpack(body)
        return cls(left * _VOLT, right * _VOLT, bool(flags & 1))


class BoardSetup(msgspec.Struct, frozen=True, gc=False):
    """The watchdog's time-out, s, 0.02 to 1."""

    watchdog_s: float

    def in_range(self) -> bool:
        """Whether every value is finite and within the DBC's range."""
        return MIN_WATCHDOG_S <= self.watchdog_s <= MAX_WATCHDOG_S

    def pack(self, counter: int) -> bytes:
        """The first seven bytes of the frame."""
        return _SETUP.pack(round(self.watchdog_s / _SECOND), counter)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """From the first seven bytes of the frame."""
        watchdog, _ = _SETUP.unpack(body)
        return cls(watchdog * _SECOND)


class Wheel(msgspec.Struct, frozen=True, gc=False):
    """Angle since power-on, rad, and angular velocity, rad/s; positive when the robot rolls forward."""

    angle: float
    velocity: float

    def in_range(self) -> bool:
        """Whether every value is finite and within the DBC's range."""
        return abs(self.angle) <= MAX_ANGLE and abs(self.velocity) <= MAX_VELOCITY

    def pack(self, counter: int) -> bytes:
        """The first seven bytes of the frame."""
        return _WHEEL.pack(round(self.angle / _RADIAN), round(self.velocity / _RADIAN_PER_SECOND), counter)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """From the first seven bytes of the frame."""
        angle, velocity, _ = _WHEEL.unpack(body)
        return cls(angle * _RADIAN, velocity * _RADIAN_PER_SECOND)


class AngularVelocity(msgspec.Struct, frozen=True, gc=False):
    """Angular velocity in the frame of the IMU, rad/s, each within +-32; x ahead, y left, z up (REP-103)."""

    x: float
    y: float
    z: float

    def in_range(self) -> bool:
        """Whether every value is finite and within the DBC's range."""
        return abs(self.x) <= MAX_TURN_RATE and abs(self.y) <= MAX_TURN_RATE and abs(self.z) <= MAX_TURN_RATE

    def pack(self, counter: int) -> bytes:
        """The first seven bytes of the frame."""
        unit = _MILLIRADIAN_PER_SECOND
        return _AXES.pack(round(self.x / unit), round(self.y / unit), round(self.z / unit), counter)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """From the first seven bytes of the frame."""
        x, y, z, _ = _AXES.unpack(body)
        return cls(x * _MILLIRADIAN_PER_SECOND, y * _MILLIRADIAN_PER_SECOND, z * _MILLIRADIAN_PER_SECOND)


class LinearAcceleration(msgspec.Struct, frozen=True, gc=False):
    """Specific force in the frame of the IMU, m/s2, each within +-160; +g on z when upright (REP-145)."""

    x: float
    y: float
    z: float

    def in_range(self) -> bool:
        """Whether every value is finite and within the DBC's range."""
        return abs(self.x) <= MAX_ACCELERATION and abs(self.y) <= MAX_ACCELERATION and abs(self.z) <= MAX_ACCELERATION

    def pack(self, counter: int) -> bytes:
        """The first seven bytes of the frame."""
        unit = _METRE_PER_SECOND_SQUARED
        return _AXES.pack(round(self.x / unit), round(self.y / unit), round(self.z / unit), counter)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """From the first seven bytes of the frame."""
        x, y, z, _ = _AXES.unpack(body)
        return cls(x * _METRE_PER_SECOND_SQUARED, y * _METRE_PER_SECOND_SQUARED, z * _METRE_PER_SECOND_SQUARED)


class BoardStatus(msgspec.Struct, frozen=True, gc=False):
    """State, supply voltage (V), the watchdog in force (s, 0 is off), and frames refused since power-on modulo 256."""

    state: BoardState
    bus_voltage: float
    watchdog_s: float
    refused_frames: int

    def in_range(self) -> bool:
        """Whether every value is finite and within the DBC's range."""
        return 0.0 <= self.bus_voltage <= MAX_BUS_VOLTAGE and 0.0 <= self.watchdog_s <= MAX_WATCHDOG_S

    def pack(self, counter: int) -> bytes:
        """The first seven bytes of the frame."""
        volts, seconds = round(self.bus_voltage / _VOLT), round(self.watchdog_s / _SECOND)
        return _STATUS.pack(self.state, volts, seconds, self.refused_frames & 0xFF, counter)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """From the first seven bytes of the frame; a state that the DBC does not name raises ValueError."""
        state, volts, seconds, refused, _ = _STATUS.unpack(body)
        return cls(BoardState(state & 0x07), volts * _VOLT, seconds * _SECOND, refused)


Payload = WheelCommand | BoardSetup | Wheel | AngularVelocity | LinearAcceleration | BoardStatus

_PAYLOADS: Final[dict[int, type[Payload]]] = {
    FrameId.WHEEL_COMMAND: WheelCommand,
    FrameId.BOARD_SETUP: BoardSetup,
    FrameId.LEFT_WHEEL: Wheel,
    FrameId.RIGHT_WHEEL: Wheel,
    FrameId.IMU_GYRO: AngularVelocity,
    FrameId.IMU_ACCELERATION: LinearAcceleration,
    FrameId.BOARD_STATUS: BoardStatus,
}


def _name(arbitration_id: int) -> str:
    return f"frame 0x{arbitration_id:03X}"


def encode(arbitration_id: FrameId, payload: Payload, counter: int) -> bytes:
    """Encode a payload with its counter (taken modulo 16) and CRC.

    Raises:
        FrameRefusedError: A value is not finite or out of the DBC's range.
    """
    if not payload.in_range():
        raise FrameRefusedError(Refusal.RANGE, _name(arbitration_id))
    body = payload.pack(counter & _COUNTER_MASK)
    return body + frame_crc(arbitration_id, body).to_bytes(1, "little")


def decode(arbitration_id: int, data: bytes) -> tuple[Payload, int]:
    """Decode a frame into its payload and counter.

    Raises:
        FrameRefusedError: Not one of ours, wrong length, wrong CRC, or a value out of range.
    """
    payload_type = _PAYLOADS.get(arbitration_id)
    if payload_type is None:
        raise FrameRefusedError(Refusal.UNKNOWN, _name(arbitration_id))
    if len(data) != _LENGTH:
        raise FrameRefusedError(Refusal.LENGTH, _name(arbitration_id))
    body = data[:_BODY]
    if frame_crc(arbitration_id, body) != data[_BODY]:
        raise FrameRefusedError(Refusal.CRC, _name(arbitration_id))
    try:
        payload = payload_type.unpack(body)
    except ValueError as error:
        raise FrameRefusedError(Refusal.RANGE, _name(arbitration_id)) from error
    if not payload.in_range():
        raise FrameRefusedError(Refusal.RANGE, _name(arbitration_id))
    return payload, body[-1] & _COUNTER_MASK
