# SPDX-License-Identifier: MIT
"""The wheel board's frames: bytes to SI and back, as wheel_board.dbc describes them, and what both ends count."""

import enum
import struct
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

from segway_ecc.firmware_io.integrity import CounterCheck, FrameRefusedError, Refusal, frame_crc
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.value import Value

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
_SESSION: Final = struct.Struct("<IHB")
_ROUND_TO_INTEGER: Final = 1.5 * 2.0**52
"""Rounds when it is added and subtracted again: a float between 2**52 and 2**53 has 52 bits after its first, none of
which is left for a fraction, so the sum of this and a number below 2**51 is rounded to a whole number by the processor,
halves to even as by `round`. Compiled, that takes a fifth of the time of a call of `round`."""
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
    BOARD_SESSION = 0x131


CYCLE_TIME_S: Final = {
    FrameId.WHEEL_COMMAND: 0.010,
    FrameId.LEFT_WHEEL: 0.005,
    FrameId.RIGHT_WHEEL: 0.005,
    FrameId.IMU_GYRO: 0.005,
    FrameId.IMU_ACCELERATION: 0.005,
    FrameId.BOARD_STATUS: 0.020,
    FrameId.BOARD_SESSION: 0.020,
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


class WheelCommand(Value, frozen=True):
    """Motor voltages, V, within +-30; `enable` False switches the motors off."""

    left_voltage: float
    right_voltage: float
    enable: bool


class BoardSetup(Value, frozen=True):
    """The watchdog's time-out, s, 0.02 to 1."""

    watchdog_s: float


class Wheel(Value, frozen=True):
    """Angle since power-on, rad, and angular velocity, rad/s; positive when the robot rolls forward."""

    angle: float
    velocity: float


class AngularVelocity(Value, frozen=True):
    """Angular velocity in the frame of the IMU, rad/s, each within +-32; x ahead, y left, z up (REP-103)."""

    x: float
    y: float
    z: float


class LinearAcceleration(Value, frozen=True):
    """Specific force in the frame of the IMU, m/s2, each within +-160; +g on z when upright (REP-145)."""

    x: float
    y: float
    z: float


class BoardStatus(Value, frozen=True):
    """State, supply voltage (V), the watchdog in force (s, 0 is off), and frames refused since power-on modulo 256."""

    state: BoardState
    bus_voltage: float
    watchdog_s: float
    refused_frames: int


class BoardSession(Value, frozen=True):
    """The session that commands of version 2 belong to (`session`), and the upper bits of the newest one's counter.

    Modulo 2**32 and 2**16.
    """

    number: int
    epoch: int


Payload = BoardSession | WheelCommand | BoardSetup | Wheel | AngularVelocity | LinearAcceleration | BoardStatus


def _steps(value: float, step: float, low: float, high: float) -> int:
    """The whole number of steps nearest to a value; ValueError where it is no number in the DBC's range."""
    if not low <= value <= high:
        raise ValueError
    return int(value / step + _ROUND_TO_INTEGER - _ROUND_TO_INTEGER)


def voltage_steps(voltage: float) -> int:
    """A motor's voltage, V, as on the wire; ValueError where it is out of range."""
    return _steps(voltage, _VOLT, -MAX_VOLTAGE, MAX_VOLTAGE)


def voltage_value(steps: int) -> float:
    """A motor's voltage, V, from the wire; ValueError where it is out of range."""
    voltage = steps * _VOLT
    if abs(voltage) > MAX_VOLTAGE:
        raise ValueError
    return voltage


def watchdog_steps(watchdog_s: float) -> int:
    """The watchdog's time, s, as on the wire; ValueError where it is out of range."""
    return _steps(watchdog_s, _SECOND, MIN_WATCHDOG_S, MAX_WATCHDOG_S)


def watchdog_value(steps: int) -> float:
    """The watchdog's time, s, from the wire; ValueError where it is out of range."""
    watchdog_s = steps * _SECOND
    if not MIN_WATCHDOG_S <= watchdog_s <= MAX_WATCHDOG_S:
        raise ValueError
    return watchdog_s


def _pack_command(payload: WheelCommand, counter: int) -> bytes:
    left, right = voltage_steps(payload.left_voltage), voltage_steps(payload.right_voltage)
    return _COMMAND.pack(left, right, payload.enable, counter)


def _unpack_command(body: bytes) -> WheelCommand:
    left, right, flags, _ = _COMMAND.unpack(body)
    return WheelCommand(voltage_value(left), voltage_value(right), bool(flags & 1))


def _pack_setup(payload: BoardSetup, counter: int) -> bytes:
    return _SETUP.pack(watchdog_steps(payload.watchdog_s), counter)


def _unpack_setup(body: bytes) -> BoardSetup:
    steps, _ = _SETUP.unpack(body)
    return BoardSetup(watchdog_value(steps))


def _pack_wheel(payload: Wheel, counter: int) -> bytes:
    angle = _steps(payload.angle, _RADIAN, -MAX_ANGLE, MAX_ANGLE)
    return _WHEEL.pack(angle, _steps(payload.velocity, _RADIAN_PER_SECOND, -MAX_VELOCITY, MAX_VELOCITY), counter)


def _unpack_wheel(body: bytes) -> Wheel:
    angle_steps, velocity_steps, _ = _WHEEL.unpack(body)
    angle, velocity = angle_steps * _RADIAN, velocity_steps * _RADIAN_PER_SECOND
    if abs(angle) > MAX_ANGLE or abs(velocity) > MAX_VELOCITY:
        raise ValueError
    return Wheel(angle, velocity)


def _pack_axes(payload: AngularVelocity | LinearAcceleration, counter: int) -> bytes:
    step, most = _METRE_PER_SECOND_SQUARED, MAX_ACCELERATION
    if isinstance(payload, AngularVelocity):
        step, most = _MILLIRADIAN_PER_SECOND, MAX_TURN_RATE
    x, y, z = payload.x, payload.y, payload.z
    return _AXES.pack(_steps(x, step, -most, most), _steps(y, step, -most, most), _steps(z, step, -most, most), counter)


def _unpack_axes(body: bytes, step: float, most: float) -> tuple[float, float, float]:
    x_steps, y_steps, z_steps, _ = _AXES.unpack(body)
    x, y, z = x_steps * step, y_steps * step, z_steps * step
    if abs(x) > most or abs(y) > most or abs(z) > most:
        raise ValueError
    return x, y, z


def _unpack_gyro(body: bytes) -> AngularVelocity:
    x, y, z = _unpack_axes(body, _MILLIRADIAN_PER_SECOND, MAX_TURN_RATE)
    return AngularVelocity(x, y, z)


def _unpack_acceleration(body: bytes) -> LinearAcceleration:
    x, y, z = _unpack_axes(body, _METRE_PER_SECOND_SQUARED, MAX_ACCELERATION)
    return LinearAcceleration(x, y, z)


def _pack_status(payload: BoardStatus, counter: int) -> bytes:
    volts = _steps(payload.bus_voltage, _VOLT, 0.0, MAX_BUS_VOLTAGE)
    seconds = _steps(payload.watchdog_s, _SECOND, 0.0, MAX_WATCHDOG_S)
    return _STATUS.pack(payload.state, volts, seconds, payload.refused_frames & 0xFF, counter)


def _unpack_status(body: bytes) -> BoardStatus:
    state, volt_steps, second_steps, refused, _ = _STATUS.unpack(body)
    volts, seconds = volt_steps * _VOLT, second_steps * _SECOND
    if volts > MAX_BUS_VOLTAGE or seconds > MAX_WATCHDOG_S:
        raise ValueError
    return BoardStatus(BoardState(state & 0x07), volts, seconds, refused)


def _pack_session(payload: BoardSession, counter: int) -> bytes:
    return _SESSION.pack(payload.number & 0xFFFFFFFF, payload.epoch & 0xFFFF, counter)


def _unpack_session(body: bytes) -> BoardSession:
    number, epoch, _ = _SESSION.unpack(body)
    return BoardSession(number, epoch)


# Functions in tables and not methods of the payloads: compiled, a method of a class of msgspec's is dearer than plain.
_PACK: Final[dict[int, Callable[[Any, int], bytes]]] = {
    FrameId.WHEEL_COMMAND: _pack_command,
    FrameId.BOARD_SETUP: _pack_setup,
    FrameId.LEFT_WHEEL: _pack_wheel,
    FrameId.RIGHT_WHEEL: _pack_wheel,
    FrameId.IMU_GYRO: _pack_axes,
    FrameId.IMU_ACCELERATION: _pack_axes,
    FrameId.BOARD_STATUS: _pack_status,
    FrameId.BOARD_SESSION: _pack_session,
}
"""The first seven bytes of each frame from its payload and counter; ValueError where a value is out of range."""
_UNPACK: Final[dict[int, Callable[[bytes], Payload]]] = {
    FrameId.WHEEL_COMMAND: _unpack_command,
    FrameId.BOARD_SETUP: _unpack_setup,
    FrameId.LEFT_WHEEL: _unpack_wheel,
    FrameId.RIGHT_WHEEL: _unpack_wheel,
    FrameId.IMU_GYRO: _unpack_gyro,
    FrameId.IMU_ACCELERATION: _unpack_acceleration,
    FrameId.BOARD_STATUS: _unpack_status,
    FrameId.BOARD_SESSION: _unpack_session,
}
"""The payload of each frame from its first seven bytes; ValueError where a value is out of range or has no name."""


def _name(arbitration_id: int) -> str:
    return f"frame 0x{arbitration_id:03X}"


def encode(arbitration_id: FrameId, payload: Payload, counter: int) -> bytes:
    """A payload with its counter (modulo 16) and CRC; FrameRefusedError where a value is out of the DBC's range."""
    try:
        body = _PACK[arbitration_id](payload, counter & _COUNTER_MASK)
    except ValueError as error:
        raise FrameRefusedError(Refusal.RANGE, _name(arbitration_id)) from error
    return body + frame_crc(arbitration_id, body).to_bytes(1, "little")


def decode(arbitration_id: int, data: bytes) -> tuple[Payload, int]:
    """A frame's payload and counter; FrameRefusedError for another frame, length or CRC, or a value out of range."""
    unpack = _UNPACK.get(arbitration_id)
    if unpack is None:
        raise FrameRefusedError(Refusal.UNKNOWN, _name(arbitration_id))
    if len(data) != _LENGTH:
        raise FrameRefusedError(Refusal.LENGTH, _name(arbitration_id))
    body = data[:_BODY]
    if frame_crc(arbitration_id, body) != data[_BODY]:
        raise FrameRefusedError(Refusal.CRC, _name(arbitration_id))
    try:
        payload = unpack(body)
    except ValueError as error:
        raise FrameRefusedError(Refusal.RANGE, _name(arbitration_id)) from error
    return payload, body[-1] & _COUNTER_MASK


class Endpoint:
    """Sends payloads over a link and checks those that arrive; `refused` counts frames by cause."""

    def __init__(self, send: Callable[[Frame], bool], listen_to: frozenset[FrameId]) -> None:
        """Speak by `send`, False where it drops the frame; frames with ids not in `listen_to` are passed over."""
        self.refused: Counter[Refusal] = Counter()
        self._send = send
        self._send_counter = dict.fromkeys(FrameId, 0)
        self._ids = {int(frame_id): frame_id for frame_id in listen_to}
        self._checks = {frame_id: CounterCheck() for frame_id in listen_to}
        self._lost_before = 0

    @property
    def lost(self) -> int:
        """Frames missing between those received, by their counters."""
        return self._lost_before + sum(check.lost for check in self._checks.values())

    def send(self, frame_id: FrameId, payload: Payload) -> bool:
        """Send a payload; False where the link dropped it."""
        counter = self._send_counter[frame_id]
        self._send_counter[frame_id] = counter + 1
        return self._send(Frame(frame_id, encode(frame_id, payload, counter)))

    def restart(self) -> None:
        """Take the next frame of each identifier whatever its counter, as after a change to another line."""
        self._lost_before = self.lost
        self._checks = {frame_id: CounterCheck() for frame_id in self._checks}

    def check(self, frame: Frame) -> Payload | None:
        """What a frame carries that is listened to and intact; None for any other, counted where it was refused."""
        frame_id = None if frame.is_extended else self._ids.get(frame.arbitration_id)
        if frame_id is None:
            return None
        try:
            payload, counter = decode(frame_id, frame.data)
        except FrameRefusedError as error:
            self.refused[error.refusal] += 1
            return None
        if not self._checks[frame_id].accepts(counter):
            self.refused[Refusal.COUNTER] += 1
            return None
        return payload
