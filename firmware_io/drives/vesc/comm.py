"""The packets of the VESC's serial protocol: what stands between the framing, in bytes and in values.

Source: the list of COMM packets in the firmware and in VESC Tool (github.com/vedderb/bldc and vesc_tool).
A set command carries the same big-endian integer as its frame on CAN. The reply to GET_VALUES carries all fields below
in order; that to GET_VALUES_SELECTIVE repeats the mask and carries the fields whose bits are set in it.
"""

import enum
import struct
from collections.abc import Collection, Mapping
from typing import Final, NamedTuple

from segway_ecc.firmware_io.drives.vesc.frames import Command
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal


@enum.unique
class Comm(enum.IntEnum):
    """The first byte of a packet."""

    GET_VALUES = 4
    SET_DUTY = 5
    SET_CURRENT = 6
    SET_CURRENT_BRAKE = 7
    SET_RPM = 8
    SET_POS = 9
    SET_HANDBRAKE = 10
    ALIVE = 30
    FORWARD_CAN = 34
    GET_VALUES_SELECTIVE = 50
    SET_CURRENT_REL = 84


SET_PACKETS: Final[Mapping[Command, Comm]] = {
    Command.SET_DUTY: Comm.SET_DUTY,
    Command.SET_CURRENT: Comm.SET_CURRENT,
    Command.SET_CURRENT_BRAKE: Comm.SET_CURRENT_BRAKE,
    Command.SET_RPM: Comm.SET_RPM,
    Command.SET_POS: Comm.SET_POS,
    Command.SET_CURRENT_HANDBRAKE: Comm.SET_HANDBRAKE,
    Command.SET_CURRENT_REL: Comm.SET_CURRENT_REL,
}
"""The packet that says what a frame says; its data are the frame's."""


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
"""The bit of `flags` that says that the controller has not been commanded for longer than its time-out."""


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
    return _known(_MASK.unpack(packet[1:])[0])


def encode_values(question: bytes, values: Mapping[str, float]) -> bytes:
    """The reply of a controller to a question.

    Args:
        question: A GET_VALUES or GET_VALUES_SELECTIVE packet, which the reply repeats.
        values: At least the values that are asked for.

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


def _known(mask: int) -> int:
    if mask & ~ALL_FIELDS:
        raise FrameRefusedError(Refusal.UNKNOWN, f"mask 0x{mask:08X}")
    return mask


def _selected(mask: int) -> list[_Field]:
    return [field for bit, field in enumerate(_FIELDS) if mask >> bit & 1]
