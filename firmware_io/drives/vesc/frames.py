"""The frames of the VESC's CAN protocol: bytes to values and back.

The 29-bit identifier carries the command in bits 8 to 15 and the controller in bits 0 to 7; the bits above are zero.
Values are big-endian integers with a scale. Nothing protects a frame but the CRC of CAN itself: there is no counter.
Source: the protocol description in VESC's firmware documentation (comm_can.md, github.com/vedderb/bldc) and the ids in
its list of CAN packets. Names carry the unit where it is not the SI one.
"""

import enum
import struct
from typing import Final, NamedTuple

from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame

BROADCAST_ID: Final = 255
"""Every controller listens to commands for this one."""


@enum.unique
class Command(enum.IntEnum):
    """What a frame says: bits 8 to 15 of its identifier."""

    SET_DUTY = 0
    SET_CURRENT = 1
    SET_CURRENT_BRAKE = 2
    SET_RPM = 3
    SET_POS = 4
    FILL_RX_BUFFER = 5
    FILL_RX_BUFFER_LONG = 6
    PROCESS_RX_BUFFER = 7
    PROCESS_SHORT_BUFFER = 8
    STATUS = 9
    SET_CURRENT_REL = 10
    SET_CURRENT_BRAKE_REL = 11
    SET_CURRENT_HANDBRAKE = 12
    SET_CURRENT_HANDBRAKE_REL = 13
    STATUS_2 = 14
    STATUS_3 = 15
    STATUS_4 = 16
    PING = 17
    PONG = 18
    CONF_CURRENT_LIMITS = 21
    CONF_STORE_CURRENT_LIMITS = 22
    CONF_CURRENT_LIMITS_IN = 23
    CONF_STORE_CURRENT_LIMITS_IN = 24
    STATUS_5 = 27
    STATUS_6 = 58


class Duty(NamedTuple):
    """Duty cycle, -1 to 1."""

    duty: float


class Current(NamedTuple):
    """Motor current, A."""

    current: float


class DelayedCurrent(NamedTuple):
    """Motor current, A, and how long the motor stays on at zero current, s.

    Releases of the firmware disagree about the order of the two, so the driver does not send it.
    """

    current: float
    off_delay: float


class RelativeCurrent(NamedTuple):
    """Motor current as a share of its limit, -1 to 1."""

    share: float


class Speed(NamedTuple):
    """Electrical turns per minute: those of the motor times its pole pairs."""

    erpm: float


class Position(NamedTuple):
    """Motor angle, degrees, 0 to 360."""

    degrees: float


class CurrentLimits(NamedTuple):
    """Limits of motor or input current, A."""

    minimum: float
    maximum: float


class Status(NamedTuple):
    """Electrical turns per minute, motor current (A), duty cycle."""

    erpm: float
    current: float
    duty: float


class Status2(NamedTuple):
    """Charge drawn and charge put back since power-on, A h."""

    amp_hours: float
    amp_hours_charged: float


class Status3(NamedTuple):
    """Energy drawn and energy put back since power-on, W h."""

    watt_hours: float
    watt_hours_charged: float


class Status4(NamedTuple):
    """Temperatures (degrees Celsius), input current (A), angle of the position controller (degrees)."""

    fet_celsius: float
    motor_celsius: float
    input_current: float
    degrees: float


class Status5(NamedTuple):
    """Tachometer, six counts for an electrical turn, and supply voltage, V."""

    tachometer: int
    bus_voltage: float


class Status6(NamedTuple):
    """Voltages at the analogue inputs, V, and the PPM input, -1 to 1."""

    adc_1: float
    adc_2: float
    adc_3: float
    ppm: float


class Ping(NamedTuple):
    """Who asks."""

    sender_id: int


class Pong(NamedTuple):
    """Who answers, and what kind of hardware it is."""

    controller_id: int
    hardware_type: int


Payload = (
    Duty
    | Current
    | DelayedCurrent
    | RelativeCurrent
    | Speed
    | Position
    | CurrentLimits
    | Status
    | Status2
    | Status3
    | Status4
    | Status5
    | Status6
    | Ping
    | Pong
)


class _Layout(NamedTuple):
    """How a payload lies in the frame: the integers, and how many of each make one unit."""

    payload: type[Payload]
    packing: struct.Struct
    per_unit: tuple[int, ...]


_CURRENT: Final = _Layout(Current, struct.Struct(">i"), (1_000,))
_SHARE: Final = _Layout(RelativeCurrent, struct.Struct(">i"), (100_000,))
_LIMITS: Final = _Layout(CurrentLimits, struct.Struct(">ii"), (1_000, 1_000))
_DELAYED: Final = _Layout(DelayedCurrent, struct.Struct(">ih"), (1_000, 1_000))

_LAYOUTS: Final[dict[int, _Layout]] = {
    Command.SET_DUTY: _Layout(Duty, struct.Struct(">i"), (100_000,)),
    Command.SET_CURRENT: _CURRENT,
    Command.SET_CURRENT_BRAKE: _CURRENT,
    Command.SET_RPM: _Layout(Speed, struct.Struct(">i"), (1,)),
    Command.SET_POS: _Layout(Position, struct.Struct(">i"), (1_000_000,)),
    Command.STATUS: _Layout(Status, struct.Struct(">ihh"), (1, 10, 1_000)),
    Command.SET_CURRENT_REL: _SHARE,
    Command.SET_CURRENT_BRAKE_REL: _SHARE,
    Command.SET_CURRENT_HANDBRAKE: _CURRENT,
    Command.SET_CURRENT_HANDBRAKE_REL: _SHARE,
    Command.STATUS_2: _Layout(Status2, struct.Struct(">ii"), (10_000, 10_000)),
    Command.STATUS_3: _Layout(Status3, struct.Struct(">ii"), (10_000, 10_000)),
    Command.STATUS_4: _Layout(Status4, struct.Struct(">hhhh"), (10, 10, 10, 50)),
    Command.PING: _Layout(Ping, struct.Struct(">B"), (1,)),
    Command.PONG: _Layout(Pong, struct.Struct(">BB"), (1, 1)),
    Command.CONF_CURRENT_LIMITS: _LIMITS,
    Command.CONF_STORE_CURRENT_LIMITS: _LIMITS,
    Command.CONF_CURRENT_LIMITS_IN: _LIMITS,
    Command.CONF_STORE_CURRENT_LIMITS_IN: _LIMITS,
    Command.STATUS_5: _Layout(Status5, struct.Struct(">ihxx"), (1, 10)),
    Command.STATUS_6: _Layout(Status6, struct.Struct(">hhhh"), (1_000, 1_000, 1_000, 1_000)),
}


_COMMANDS: Final = {int(command): command for command in Command}


def arbitration_id(command: Command, controller_id: int) -> int:
    """The 29-bit identifier of a frame to or from a controller (0 to 255)."""
    return command << 8 | controller_id


def addressed(frame: Frame) -> tuple[Command, int] | None:
    """What a frame says and to or from which controller; None for a frame that is not VESC's."""
    number, controller_id = divmod(frame.arbitration_id, 1 << 8)
    command = _COMMANDS.get(number) if frame.is_extended else None
    return None if command is None else (command, controller_id)


def encode(command: Command, payload: Payload) -> bytes:
    """The data of a frame.

    Raises:
        FrameRefusedError: The payload is not that command's, or a value is not finite or does not fit its integer.
    """
    layout = (
        _DELAYED if command is Command.SET_CURRENT and isinstance(payload, DelayedCurrent) else _LAYOUTS.get(command)
    )
    if layout is None or not isinstance(payload, layout.payload):
        raise FrameRefusedError(Refusal.UNKNOWN, f"{command.name} with {type(payload).__name__}")
    try:
        raw = [round(value * scale) for value, scale in zip(payload, layout.per_unit, strict=True)]
        return layout.packing.pack(*raw)
    except (ValueError, OverflowError, struct.error) as error:
        raise FrameRefusedError(Refusal.RANGE, f"{command.name} {payload}") from error


def decode(command: int, data: bytes) -> Payload:
    """The payload of a frame.

    Raises:
        FrameRefusedError: The command is not one of the table's, or the length is not that command's.
    """
    layout = _LAYOUTS.get(command)
    if layout is None:
        raise FrameRefusedError(Refusal.UNKNOWN, f"command {command}")
    if command == Command.SET_CURRENT and len(data) == _DELAYED.packing.size:
        layout = _DELAYED
    if len(data) != layout.packing.size:
        raise FrameRefusedError(Refusal.LENGTH, f"{Command(command).name} of {len(data)} bytes")
    raw = layout.packing.unpack(data)
    values = [n if scale == 1 else n / scale for n, scale in zip(raw, layout.per_unit, strict=True)]
    return layout.payload._make(values)


def frame_of(command: Command, controller_id: int, payload: Payload) -> Frame:
    """A whole frame; see `encode`."""
    return Frame(arbitration_id(command, controller_id), encode(command, payload), is_extended=True)
