# SPDX-License-Identifier: MIT
"""The VESC's CAN frames and the packets of its serial protocol: bytes to SI and back.

The 29-bit identifier carries the command in bits 8 to 15 and the controller in bits 0 to 7; the bits above are zero.
Values are big-endian integers with a scale. Nothing protects a frame but the CRC of CAN itself: there is no counter.
Source: the protocol description in VESC's firmware documentation (comm_can.md, github.com/vedderb/bldc) and the ids in
its list of CAN packets. Names carry the unit where it is not the SI one.

A packet, between its framing (see `packets`), is a command byte and big-endian integers. A set command carries the same
integer as its frame on CAN. The reply to GET_VALUES carries all fields below in order; that to GET_VALUES_SELECTIVE
repeats the mask and carries the fields whose bits are set in it. Source: the list of COMM packets in the firmware and
in VESC Tool (github.com/vedderb/bldc and vesc_tool).
"""

import enum
import math
import struct
from collections.abc import Collection, Mapping
from typing import Any, Final, NamedTuple

from segway_ecc.firmware_io.devices import TURN
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame

_STEPS_PER_TURN: Final = 6
BROADCAST_ID: Final = 255
"""Every controller listens to commands for this one."""


@enum.unique
class PacketId(enum.IntEnum):
    """The kind of a frame: bits 8 to 15 of its identifier."""

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


COMMANDING: Final = frozenset(packet for packet in PacketId if packet.name.startswith("SET_"))
"""What moves a motor. Questions are left out: a controller passes on those that it has over its serial line."""


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
    """Electrical turns per minute, motor current (A), duty cycle.

    The current has the sign of the motor's power: positive where it drives, negative where it brakes, in whichever
    direction (`mc_interface_get_tot_current_filtered` in the firmware).
    """

    erpm: float
    current: float
    duty: float

    def motor_velocity(self, pole_pairs: int) -> float:
        """Velocity of the motor's shaft, rad/s."""
        return self.erpm * TURN / (60.0 * pole_pairs)

    def directed_current(self) -> float:
        """The motor current with the direction of its torque, A: voltage times current is the power.

        At a voltage too small for the wire, 0.1 % of the supply, a current of any size brakes, against the speed.
        """
        if self.duty:
            return math.copysign(1.0, self.duty) * self.current
        return -math.copysign(self.current, self.erpm) if self.erpm else 0.0


class Status5(NamedTuple):
    """Tachometer, six counts for an electrical turn, and supply voltage, V."""

    tachometer: int
    bus_voltage: float


class Ping(NamedTuple):
    """Who asks."""

    sender_id: int


class Pong(NamedTuple):
    """Who answers, and what kind of hardware it is."""

    controller_id: int
    hardware_type: int


def motor_angle(tachometer: int, pole_pairs: int) -> float:
    """Angle of the motor's shaft, rad, at a tachometer followed over its wraps."""
    return tachometer * TURN / (_STEPS_PER_TURN * pole_pairs)


Payload = tuple[Any, ...]
"""One of the above."""


class _PayloadLayout(NamedTuple):
    """How a payload lies in the frame: the integers, and how many of each make one unit."""

    payload: type[Any]
    packing: struct.Struct
    per_unit: tuple[int, ...]


_CURRENT: Final = _PayloadLayout(Current, struct.Struct(">i"), (1_000,))
_SHARE: Final = _PayloadLayout(RelativeCurrent, struct.Struct(">i"), (100_000,))
_LIMITS: Final = _PayloadLayout(CurrentLimits, struct.Struct(">ii"), (1_000, 1_000))
_DELAYED: Final = _PayloadLayout(DelayedCurrent, struct.Struct(">ih"), (1_000, 1_000))

_LAYOUTS: Final[dict[int, _PayloadLayout]] = {
    PacketId.SET_DUTY: _PayloadLayout(Duty, struct.Struct(">i"), (100_000,)),
    PacketId.SET_CURRENT: _CURRENT,
    PacketId.SET_CURRENT_BRAKE: _CURRENT,
    PacketId.SET_RPM: _PayloadLayout(Speed, struct.Struct(">i"), (1,)),
    PacketId.SET_POS: _PayloadLayout(Position, struct.Struct(">i"), (1_000_000,)),
    PacketId.STATUS: _PayloadLayout(Status, struct.Struct(">ihh"), (1, 10, 1_000)),
    PacketId.SET_CURRENT_REL: _SHARE,
    PacketId.SET_CURRENT_BRAKE_REL: _SHARE,
    PacketId.SET_CURRENT_HANDBRAKE: _CURRENT,
    PacketId.SET_CURRENT_HANDBRAKE_REL: _SHARE,
    PacketId.PING: _PayloadLayout(Ping, struct.Struct(">B"), (1,)),
    PacketId.PONG: _PayloadLayout(Pong, struct.Struct(">BB"), (1, 1)),
    PacketId.CONF_CURRENT_LIMITS: _LIMITS,
    PacketId.CONF_STORE_CURRENT_LIMITS: _LIMITS,
    PacketId.CONF_CURRENT_LIMITS_IN: _LIMITS,
    PacketId.CONF_STORE_CURRENT_LIMITS_IN: _LIMITS,
    PacketId.STATUS_5: _PayloadLayout(Status5, struct.Struct(">ihxx"), (1, 10)),
}


_COMMANDS: Final = {int(command): command for command in PacketId}


def arbitration_id(command: PacketId, controller_id: int) -> int:
    """The 29-bit identifier of a frame to or from a controller (0 to 255)."""
    return command << 8 | controller_id


def addressed(frame: Frame) -> tuple[PacketId, int] | None:
    """The kind of a frame and its controller; None for a frame that is not VESC's."""
    number, controller_id = divmod(frame.arbitration_id, 1 << 8)
    command = _COMMANDS.get(number) if frame.is_extended else None
    return None if command is None else (command, controller_id)


def encode(command: PacketId, payload: Payload) -> bytes:
    """The data of a frame; FrameRefusedError for the payload of another command, or a value that does not fit."""
    layout = (
        _DELAYED if command is PacketId.SET_CURRENT and isinstance(payload, DelayedCurrent) else _LAYOUTS.get(command)
    )
    if layout is None or not isinstance(payload, layout.payload):
        raise FrameRefusedError(Refusal.UNKNOWN, f"{command.name} with {type(payload).__name__}")
    try:
        raw = [round(value * scale) for value, scale in zip(payload, layout.per_unit, strict=True)]
        return layout.packing.pack(*raw)
    except (ValueError, OverflowError, struct.error) as error:
        raise FrameRefusedError(Refusal.RANGE, f"{command.name} {payload}") from error


def decode(command: int, data: bytes) -> Payload:
    """The payload of a frame; FrameRefusedError for a command that is not in the table, or another length."""
    layout = _LAYOUTS.get(command)
    if layout is None:
        raise FrameRefusedError(Refusal.UNKNOWN, f"command {command}")
    if command == PacketId.SET_CURRENT and len(data) == _DELAYED.packing.size:
        layout = _DELAYED
    if len(data) != layout.packing.size:
        raise FrameRefusedError(Refusal.LENGTH, f"{PacketId(command).name} of {len(data)} bytes")
    raw = layout.packing.unpack(data)
    values = [n if scale == 1 else n / scale for n, scale in zip(raw, layout.per_unit, strict=True)]
    payload: Payload = layout.payload._make(values)
    return payload


def frame_of(command: PacketId, controller_id: int, payload: Payload) -> Frame:
    """A whole frame; see `encode`."""
    return Frame(arbitration_id(command, controller_id), encode(command, payload), is_extended=True)


@enum.unique
class Comm(enum.IntEnum):
    """The first byte of a packet."""

    FW_VERSION = 0
    GET_VALUES = 4
    SET_DUTY = 5
    SET_CURRENT = 6
    SET_CURRENT_BRAKE = 7
    SET_RPM = 8
    SET_POS = 9
    SET_HANDBRAKE = 10
    GET_MCCONF = 14
    ALIVE = 30
    FORWARD_CAN = 34
    GET_VALUES_SELECTIVE = 50
    SET_CURRENT_REL = 84


SET_PACKETS: Final[Mapping[PacketId, Comm]] = {
    PacketId.SET_DUTY: Comm.SET_DUTY,
    PacketId.SET_CURRENT: Comm.SET_CURRENT,
    PacketId.SET_CURRENT_BRAKE: Comm.SET_CURRENT_BRAKE,
    PacketId.SET_RPM: Comm.SET_RPM,
    PacketId.SET_POS: Comm.SET_POS,
    PacketId.SET_CURRENT_HANDBRAKE: Comm.SET_HANDBRAKE,
    PacketId.SET_CURRENT_REL: Comm.SET_CURRENT_REL,
}
"""The packet that carries the same command as a frame; its data are the frame's."""


class _Field(NamedTuple):
    """One bit of the mask: its values, their integers, and how many make one unit."""

    names: tuple[str, ...]
    packing: struct.Struct
    per_unit: int


_I8: Final = struct.Struct(">B")
_I16: Final = struct.Struct(">h")
_I32: Final = struct.Struct(">i")
_MASK: Final = struct.Struct(">I")

_FIELDS: Final = (
    _Field(("fet_celsius",), _I16, 10),
    _Field(("motor_celsius",), _I16, 10),
    _Field(("motor_current",), _I32, 100),
    _Field(("input_current",), _I32, 100),
    _Field(("d_current",), _I32, 100),
    _Field(("q_current",), _I32, 100),
    _Field(("duty",), _I16, 1_000),
    _Field(("erpm",), _I32, 1),
    _Field(("bus_voltage",), _I16, 10),
    _Field(("amp_hours",), _I32, 10_000),
    _Field(("amp_hours_charged",), _I32, 10_000),
    _Field(("watt_hours",), _I32, 10_000),
    _Field(("watt_hours_charged",), _I32, 10_000),
    _Field(("tachometer",), _I32, 1),
    _Field(("tachometer_absolute",), _I32, 1),
    _Field(("fault",), _I8, 1),
    _Field(("degrees",), _I32, 1_000_000),
    _Field(("controller_id",), _I8, 1),
    _Field(("mos_1_celsius", "mos_2_celsius", "mos_3_celsius"), struct.Struct(">hhh"), 10),
    _Field(("d_voltage",), _I32, 1_000),
    _Field(("q_voltage",), _I32, 1_000),
    _Field(("flags",), _I8, 1),
)
FIELD_NAMES: Final = tuple(name for field in _FIELDS for name in field.names)
"""Every value that a reply may carry, in order; those without a unit in their name are in SI, `erpm` per minute."""
ALL_FIELDS: Final = (1 << len(_FIELDS)) - 1
TIMED_OUT: Final = 0x01
"""The bit of `flags`: the controller has not been commanded for longer than its time-out."""


def mask_of(names: Collection[str]) -> int:
    """The mask that asks for some values; those that share a bit come together."""
    return sum(1 << bit for bit, field in enumerate(_FIELDS) if not set(names).isdisjoint(field.names))


def ask_selective(mask: int) -> bytes:
    """The packet that asks for the fields of a mask."""
    return bytes((Comm.GET_VALUES_SELECTIVE,)) + _MASK.pack(mask)


def forward(controller_id: int, packet: bytes) -> bytes:
    """The packet that has a controller hand another packet on over CAN."""
    return bytes((Comm.FORWARD_CAN, controller_id)) + packet


def read_mask(packet: bytes) -> int:
    """The mask that a GET_VALUES or GET_VALUES_SELECTIVE packet asks for.

    Raises:
        FrameRefusedError: It asks for neither, has the wrong length, or has bits that are not in the table.
    """
    if packet == bytes((Comm.GET_VALUES,)):
        return ALL_FIELDS
    if packet[:1] != bytes((Comm.GET_VALUES_SELECTIVE,)):
        raise FrameRefusedError(Refusal.UNKNOWN, "question")
    if len(packet) != 1 + _MASK.size:
        raise FrameRefusedError(Refusal.LENGTH, f"GET_VALUES_SELECTIVE of {len(packet)} bytes")
    mask = int(_MASK.unpack(packet[1:])[0])
    if mask & ~ALL_FIELDS:
        raise FrameRefusedError(Refusal.UNKNOWN, f"mask 0x{mask:08X}")
    return mask


def encode_values(question: bytes, values: Mapping[str, float]) -> bytes:
    """The reply of a controller to a question with at least the values that it asks for.

    The question is a GET_VALUES or GET_VALUES_SELECTIVE packet, which the reply repeats.

    Raises:
        FrameRefusedError: As for `read_mask`; or a value is not finite or does not fit its integer.
    """
    mask = read_mask(question)
    reply = bytearray(question)
    try:
        for field in _selected(mask):
            reply += field.packing.pack(*(round(values[name] * field.per_unit) for name in field.names))
    except (ValueError, OverflowError, struct.error) as error:
        raise FrameRefusedError(Refusal.RANGE, f"reply {dict(values)}") from error
    return bytes(reply)


def decode_values(packet: bytes) -> tuple[int, dict[str, float]]:
    """The mask that was asked for, and the values of a reply to GET_VALUES or GET_VALUES_SELECTIVE.

    Older firmware does not know the later fields and ends its reply before them, newer firmware adds some to
    GET_VALUES; a reply that ends within a field, or that goes on after the last selected one, is refused.

    Raises:
        FrameRefusedError: It is another packet, its length does not fit its mask, or the mask has unknown bits.
    """
    is_selective = packet[:1] == bytes((Comm.GET_VALUES_SELECTIVE,))
    start = 1 + _MASK.size if is_selective else 1
    mask = read_mask(packet[:start])
    values: dict[str, float] = {}
    for field in _selected(mask):
        if start == len(packet):
            return mask, values
        if start + field.packing.size > len(packet):
            raise FrameRefusedError(Refusal.LENGTH, f"reply of {len(packet)} bytes")
        raw = field.packing.unpack_from(packet, start)
        values |= zip(field.names, (n if field.per_unit == 1 else n / field.per_unit for n in raw), strict=True)
        start += field.packing.size
    if is_selective and start != len(packet):
        raise FrameRefusedError(Refusal.LENGTH, f"reply of {len(packet)} bytes")
    return mask, values


def _selected(mask: int) -> list[_Field]:
    return [field for bit, field in enumerate(_FIELDS) if mask >> bit & 1]
