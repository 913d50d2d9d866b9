# SPDX-License-Identifier: MIT
"""The CANopen frames that a CiA 402 drive is run with: bytes to SI and back, and the states that they carry.

Layouts follow CiA 301 (object identifiers, NMT, SYNC, EMCY, heartbeat, expedited SDO) and, in the PDOs, the objects of
CiA 402 as `PDOS` maps them. Everything is little-endian.
"""

import enum
import struct
from typing import Final, NamedTuple, Self

from segway_ecc.firmware_io.devices import TURN
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame

PERMILLE: Final = 0.001
"""Step of 0x6071 and 0x6077, in parts of the rated torque."""
MAX_TORQUE_SHARE: Final = 32.767
"""Largest magnitude of a torque in a frame, in parts of the rated torque."""

_COMMAND: Final = struct.Struct("<Hh")
_STATUS: Final = struct.Struct("<Hih")
_VELOCITY: Final = struct.Struct("<i")
_SUPPLY: Final = struct.Struct("<I")
_MILLIVOLT: Final = 0.001
_MILLINEWTONMETRE: Final = 0.001
_EMERGENCY: Final = struct.Struct("<HB5s")
_SDO: Final = struct.Struct("<BHB4s")
SDO_READ: Final = 0x40
"""First byte of a request to read, and specifier of its answer."""
_SDO_WRITE: Final = 0x20
_SDO_WRITTEN: Final = 0x60
_SDO_ABORTED: Final = 0x80
_SDO_SPECIFIER: Final = 0xE0


@enum.unique
class Service(enum.IntEnum):
    """The predefined connection set: an identifier is one of these plus the node's id, 1 to 127."""

    NMT = 0x000
    """To all nodes: this is the whole identifier."""
    SYNC = 0x080
    """To all nodes: this is the whole identifier; EMCY shares it, with a node's id."""
    TPDO1 = 0x180
    RPDO1 = 0x200
    TPDO2 = 0x280
    TPDO3 = 0x380
    TPDO4 = 0x480
    SDO_REPLY = 0x580
    SDO_REQUEST = 0x600
    HEARTBEAT = 0x700


EMERGENCY: Final = Service.SYNC


class MappedObject(NamedTuple):
    """An object in a PDO."""

    object_index: int
    bits: int


PDOS: Final = {
    Service.RPDO1: (MappedObject(0x6040, 16), MappedObject(0x6071, 16)),
    Service.TPDO1: (MappedObject(0x6041, 16), MappedObject(0x6064, 32), MappedObject(0x6077, 16)),
    Service.TPDO2: (MappedObject(0x606C, 32),),
    Service.TPDO3: (MappedObject(0x6079, 32),),
}
"""What the PDOs carry; in sub-index 0 of each object. A drive need not have 0x6079."""


@enum.unique
class NmtCommand(enum.IntEnum):
    """NMT commands: what the host requests of a node's communication."""

    START = 0x01
    STOP = 0x02
    PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


@enum.unique
class NmtState(enum.IntEnum):
    """NMT states, as a node's heartbeat carries them."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class TorqueCommand(NamedTuple):
    """RPDO1: the controlword (0x6040), and the target torque (0x6071) in parts of the rated torque, +-32.767."""

    controlword: int
    torque_share: float

    def pack(self) -> bytes:
        """The frame's data; FrameRefusedError where a value is not finite or out of range."""
        try:
            return _COMMAND.pack(self.controlword, round(self.torque_share / PERMILLE))
        except (struct.error, ValueError, OverflowError) as error:
            raise FrameRefusedError(Refusal.RANGE, "a command") from error

    @classmethod
    def of(cls, controlword: int, motor_torque: float, rated_torque: float | None) -> Self:
        """With a torque of the motor, N m; zero where its rated torque, N m, is not known."""
        return cls(controlword, motor_torque / rated_torque if rated_torque else 0.0)


class DriveStatus(NamedTuple):
    """TPDO1: statusword (0x6041), position (0x6064) in counts, torque (0x6077) in parts of the rated torque."""

    statusword: int
    position_counts: int
    torque_share: float

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """From a frame's data; FrameRefusedError for a wrong length."""
        _check(data, _STATUS.size, "a status")
        statusword, counts, permille = _STATUS.unpack(data)
        return cls(statusword, counts, permille * PERMILLE)

    def motor_torque(self, rated_torque: float) -> float:
        """The torque of a motor with this rated torque, N m."""
        return self.torque_share * rated_torque


def motor_angle(counts: int, counts_per_turn: int) -> float:
    """The angle of the motor, rad, at a position (0x6064) followed over its wraps."""
    return counts / counts_per_turn * TURN


def rated_torque(raw: int) -> float:
    """The rated torque of the motor (0x6076), N m."""
    return raw * _MILLINEWTONMETRE


def motor_velocity(data: bytes, unit_turns: float) -> float:
    """TPDO2: the velocity (0x606C) of the motor, rad/s, of which the drive's unit is `unit_turns` turns a second.

    Raises:
        FrameRefusedError: Wrong length.
    """
    _check(data, _VELOCITY.size, "a velocity")
    (velocity,) = _VELOCITY.unpack(data)
    return float(velocity * unit_turns * TURN)


def unpack_supply(data: bytes) -> float:
    """TPDO3: the voltage of the DC link (0x6079), V; FrameRefusedError for a wrong length."""
    _check(data, _SUPPLY.size, "a supply voltage")
    (millivolts,) = _SUPPLY.unpack(data)
    return float(millivolts * _MILLIVOLT)


class Emergency(NamedTuple):
    """EMCY: error code (0x603F), error register (0x1001) and five bytes of the manufacturer's; code 0 is all clear."""

    code: int
    register: int
    detail: bytes = bytes(5)

    def pack(self) -> bytes:
        """The frame's data."""
        return _EMERGENCY.pack(*self)

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """From a frame's data; FrameRefusedError for a wrong length."""
        _check(data, _EMERGENCY.size, "an emergency")
        return cls(*_EMERGENCY.unpack(data))

    @property
    def description(self) -> str:
        """The class of the error and its code, for people."""
        named = next((name for code, mask, name in _EMERGENCY_CLASSES if self.code & mask == code), "reserved")
        return f"EMCY 0x{self.code:04X} ({named})"


_EMERGENCY_CLASSES: Final = (
    (0x0000, 0xFF00, "no error"),
    (0x1000, 0xFF00, "generic"),
    (0x2000, 0xF000, "current"),
    (0x3000, 0xF000, "voltage"),
    (0x4000, 0xF000, "temperature"),
    (0x5000, 0xFF00, "hardware of the drive"),
    (0x6000, 0xF000, "software of the drive"),
    (0x7300, 0xFF00, "sensor"),
    (0x7000, 0xF000, "additional modules"),
    (0x8110, 0xFFFF, "CAN overrun"),
    (0x8120, 0xFFFF, "CAN error passive"),
    (0x8130, 0xFFFF, "heartbeat of the host missed"),
    (0x8140, 0xFFFF, "recovered from bus-off"),
    (0x8100, 0xFF00, "communication"),
    (0x8200, 0xFF00, "protocol"),
    (0x8000, 0xF000, "monitoring"),
    (0x9000, 0xFF00, "external"),
    (0xFF00, 0xFF00, "of the manufacturer"),
    (0xF000, 0xFF00, "additional functions"),
)
"""Code, mask and name; the first that fits counts (CiA 301, emergency error codes)."""


def nmt_frame(command: NmtCommand, node_id: int) -> Frame:
    """The NMT frame to one node, or with node id 0 to all."""
    return Frame(Service.NMT, bytes((command, node_id)))


def pack_heartbeat(state: NmtState) -> bytes:
    """The data of a heartbeat."""
    return bytes((state,))


def unpack_heartbeat(data: bytes) -> NmtState:
    """The state that a heartbeat carries; FrameRefusedError for a wrong length, or where there is no such state."""
    _check(data, 1, "a heartbeat")
    try:
        return NmtState(data[0])
    except ValueError as error:
        raise FrameRefusedError(Refusal.RANGE, "a heartbeat") from error


class Sdo(NamedTuple):
    """An SDO frame of the expedited kind: what it is, an object's index and sub-index, and up to four bytes of it."""

    specifier: int
    object_index: int
    subindex: int
    data: bytes = bytes(4)

    def pack(self) -> bytes:
        """The frame's data."""
        return _SDO.pack(self.specifier, self.object_index, self.subindex, self.data)

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """From a frame's data; FrameRefusedError for a wrong length."""
        _check(data, _SDO.size, "an SDO")
        return cls(*_SDO.unpack(data))


@enum.unique
class DriveState(enum.StrEnum):
    """The states of the profile, by the statusword (0x6041)."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION_ACTIVE = "fault reaction active"
    FAULT = "fault"


class Controlword(enum.IntEnum):
    """The commands of the profile (0x6040)."""

    DISABLE_VOLTAGE = 0x00
    QUICK_STOP = 0x02
    SHUTDOWN = 0x06
    SWITCH_ON = 0x07
    ENABLE_OPERATION = 0x0F
    FAULT_RESET = 0x80


_BY_SIX_BITS: Final = {
    0x21: DriveState.READY,
    0x23: DriveState.SWITCHED_ON,
    0x27: DriveState.OPERATION_ENABLED,
    0x07: DriveState.QUICK_STOP_ACTIVE,
}
_BY_FIVE_BITS: Final = {
    0x00: DriveState.NOT_READY,
    0x40: DriveState.SWITCH_ON_DISABLED,
    0x08: DriveState.FAULT,
    0x0F: DriveState.FAULT_REACTION_ACTIVE,
}


def state_of(statusword: int) -> DriveState | None:
    """The state that a statusword carries, by the profile's masks; None for one that the profile does not know."""
    return _BY_SIX_BITS.get(statusword & 0x6F) or _BY_FIVE_BITS.get(statusword & 0x4F)


WITHOUT_TORQUE: Final = frozenset(DriveState) - {
    DriveState.OPERATION_ENABLED,
    DriveState.QUICK_STOP_ACTIVE,
    DriveState.FAULT_REACTION_ACTIVE,
}
"""The states in which the profile has the drive function disabled; a quick stop and a fault's reaction brake."""

_TOWARDS_OPERATION: Final = {
    DriveState.SWITCH_ON_DISABLED: Controlword.SHUTDOWN,
    DriveState.READY: Controlword.SWITCH_ON,
    DriveState.SWITCHED_ON: Controlword.ENABLE_OPERATION,
    DriveState.OPERATION_ENABLED: Controlword.ENABLE_OPERATION,
}


def step_towards_operation(state: DriveState | None, last_sent: int) -> Controlword:
    """The controlword of the next step to "operation enabled"; disables the voltage where there is nothing better.

    A fault is reset by a rising edge: after a reset something else is sent before the next.
    """
    if state is DriveState.FAULT and last_sent != Controlword.FAULT_RESET:
        return Controlword.FAULT_RESET
    return _TOWARDS_OPERATION.get(state, Controlword.DISABLE_VOLTAGE) if state else Controlword.DISABLE_VOLTAGE


def is_answer(request: bytes, answer: bytes) -> bool:
    """Whether an SDO frame answers a request: it bears the same object, and fits what was asked of it.

    An SDO has no checksum, so a frame of a stranger under the drive's identifier would else be its answer. A segment of
    a longer transfer bears no object; of an abort, some drives leave it zero.
    """
    specifier = request[0] & _SDO_SPECIFIER
    if specifier not in (SDO_READ, _SDO_WRITE):
        return True
    if answer[0] == _SDO_ABORTED:
        return _object_in(answer) in (_object_in(request), bytes(3))
    expected = SDO_READ if specifier == SDO_READ else _SDO_WRITTEN
    return answer[0] & _SDO_SPECIFIER == expected and _object_in(answer) == _object_in(request)


def _object_in(sdo: bytes) -> bytes:
    """The index and subindex that an SDO bears."""
    return sdo[1:4]


def _check(data: bytes, length: int, what: str) -> None:
    if len(data) != length:
        raise FrameRefusedError(Refusal.LENGTH, what)
