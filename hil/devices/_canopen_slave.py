# SPDX-License-Identifier: MIT
"""A CANopen node as CiA 301 defines it: object dictionary, SDO server, NMT, heartbeats, PDOs on SYNC."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Final

from segway_ecc.firmware_io.drives.cia402.frames import (
    EMERGENCY,
    Emergency,
    NmtCommand,
    NmtState,
    Sdo,
    Service,
    pack_heartbeat,
    unpack_heartbeat,
)
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame, Link

PDOS: Final = 4
"""Of each direction."""
NOT_VALID: Final = 1 << 31
"""Of a COB-ID: the PDO is switched off."""
RPDO: Final = 0x1400
RPDO_MAPPING: Final = 0x1600
TPDO: Final = 0x1800
TPDO_MAPPING: Final = 0x1A00
ABORTED: Final = 0x80
"""The specifier of an SDO frame that ends a transfer."""
_MAX_PDO_BITS: Final = 64
MAX_MAPPED: Final = 8
_PROFILE: Final = 0x2000
"""Below are the objects of communication."""
_READ: Final = 0x40
_WRITE: Final = 0x20
_COMMAND_MASK: Final = 0xE0
_WRITTEN: Final = 0x60
_EXPEDITED: Final = 0x02
_SIZED: Final = 0x01
_SYNCHRONOUS: Final = range(241)
_NS_PER_MS: Final = 1_000_000
HEARTBEAT_LOST: Final = Emergency(0x8130, 0x11)
"""Error register: generic, and communication."""
ALL_CLEAR: Final = Emergency(0, 0)

Key = tuple[int, int]
"""Index and sub-index."""


class Abort:
    """SDO abort codes (CiA 301)."""

    COMMAND: Final = 0x05040001
    READ_ONLY: Final = 0x06010002
    NO_OBJECT: Final = 0x06020000
    NOT_MAPPABLE: Final = 0x06040041
    PDO_LENGTH: Final = 0x06040042
    LENGTH: Final = 0x06070010
    VALUE: Final = 0x06090030
    NO_SUBINDEX: Final = 0x06090011
    STATE: Final = 0x08000022


class SdoAbortError(Exception):
    """A request that the dictionary does not grant."""

    def __init__(self, code: int) -> None:
        """Keep the code."""
        self.code = code
        super().__init__(f"0x{code:08X}")


@dataclass(slots=True)
class ObjectEntry:
    """An object: its value as an unsigned number of `size` bytes, and what may be done with it.

    `allowed` are the only values that may be written by SDO; None for any.
    """

    size: int
    value: int = 0
    access: str = "rw"
    mappable: bool = False
    allowed: Collection[int] | None = None

    @property
    def signed(self) -> int:
        """The value as two's complement."""
        half = 1 << (8 * self.size - 1)
        return (self.value + half) % (2 * half) - half

    def put(self, value: int) -> None:
        """Keep a number, signed or not; it wraps."""
        self.value = value % (1 << 8 * self.size)


class ObjectDictionary:
    """Objects by index and sub-index, and what reads and writes of them over the bus come to."""

    def __init__(self, defaults: Mapping[Key, ObjectEntry]) -> None:
        """Begin with the defaults."""
        self._defaults = defaults
        self._objects = {key: replace(entry) for key, entry in defaults.items()}

    def __getitem__(self, key: Key) -> ObjectEntry:
        """An object that is there."""
        return self._objects[key]

    def reset(self, *, communication_only: bool) -> None:
        """Bring objects back to their defaults."""
        for key, entry in self._defaults.items():
            if key[0] < _PROFILE or not communication_only:
                self._objects[key] = replace(entry)

    def mapped(self, index: int) -> list[ObjectEntry]:
        """The objects that the mapping at `index` names."""
        count = self._objects[index, 0].value
        keys = (self._objects[index, place].value for place in range(1, count + 1))
        return [self._objects[key >> 16, key >> 8 & 0xFF] for key in keys]

    def serve(self, request: Sdo) -> Sdo:
        """The answer to an SDO request; transfers of more than four bytes are not offered."""
        key = (request.object_index, request.subindex)
        command = request.specifier & _COMMAND_MASK
        try:
            if command == _READ:
                entry = self._entry(key)
                specifier = _READ | (4 - entry.size) << 2 | _EXPEDITED | _SIZED
                return Sdo(specifier, *key, entry.value.to_bytes(4, "little"))
            if command == _WRITE and request.specifier & _EXPEDITED:
                entry = self._entry(key)
                size = 4 - (request.specifier >> 2 & 0x03) if request.specifier & _SIZED else entry.size
                self._write(key, entry, request.data[:size])
                return Sdo(_WRITTEN, *key)
        except SdoAbortError as abort:
            return Sdo(ABORTED, *key, abort.code.to_bytes(4, "little"))
        return Sdo(ABORTED, *key, Abort.COMMAND.to_bytes(4, "little"))

    def _entry(self, key: Key) -> ObjectEntry:
        entry = self._objects.get(key)
        if entry is None:
            raise SdoAbortError(Abort.NO_SUBINDEX if (key[0], 0) in self._objects else Abort.NO_OBJECT)
        return entry

    def _write(self, key: Key, entry: ObjectEntry, data: bytes) -> None:
        if "w" not in entry.access:
            raise SdoAbortError(Abort.READ_ONLY)
        if len(data) != entry.size:
            raise SdoAbortError(Abort.LENGTH)
        value = int.from_bytes(data, "little")
        if RPDO_MAPPING <= key[0] < RPDO_MAPPING + PDOS or TPDO_MAPPING <= key[0] < TPDO_MAPPING + PDOS:
            self._check_mapping(key, value)
        if entry.allowed is not None and value not in entry.allowed:
            raise SdoAbortError(Abort.VALUE)
        entry.value = value

    def _check_mapping(self, key: Key, value: int) -> None:
        """A mapping is changed while its PDO is not valid, entry by entry while it counts none."""
        index, place = key
        is_valid = not self._objects[index - 0x200, 1].value & NOT_VALID
        if is_valid or (place and self._objects[index, 0].value):
            raise SdoAbortError(Abort.STATE)
        if not place:
            bits = [self._objects[index, n].value & 0xFF for n in range(1, min(value, MAX_MAPPED) + 1)]
            if value > MAX_MAPPED or 0 in bits or sum(bits) > _MAX_PDO_BITS:
                raise SdoAbortError(Abort.PDO_LENGTH)
            return
        target = self._objects.get((value >> 16, value >> 8 & 0xFF))
        if target is None or not target.mappable or value & 0xFF != 8 * target.size:
            raise SdoAbortError(Abort.NOT_MAPPABLE)


class CanopenSlave:
    """One node. What it does beyond communicating is the business of whoever owns it, through `objects`.

    `refused_frames` counts frames for it that it could not use since power-on.
    """

    def __init__(
        self, link: Link, node_id: int, defaults: Mapping[Key, ObjectEntry], on_host_lost: Callable[[], None]
    ) -> None:
        """Switch a node on.

        Args:
            link: What it sends over.
            node_id: Its id.
            defaults: The objects of its profile, as after a reset.
            on_host_lost: Called when the connection is lost: a heartbeat that it watches (0x1016) has stopped, or the
                host has stopped or reset its communication.
        """
        self.node_id = node_id
        self.refused_frames = 0
        self.is_powered = True
        self._link = link
        self._on_host_lost = on_host_lost
        self.objects = ObjectDictionary({**_communication_defaults(node_id), **defaults})
        self.reset()

    def reset(self, *, communication_only: bool = False) -> None:
        """Begin anew with objects at their defaults, as after power-on; a boot-up is due."""
        self.objects.reset(communication_only=communication_only)
        self.nmt = NmtState.BOOT_UP
        self._beat_ns = 0
        self._host_beat_ns: int | None = None
        self._host_is_lost = False
        self._due: list[int] = []
        self._syncs = [0] * PDOS
        self._received: dict[int, bytes] = {}

    def receive(self, frame: Frame, now_ns: int) -> None:
        """Process a frame of the bus; one that is not for this node changes nothing."""
        if frame.is_extended or not self.is_powered:
            return
        identifier, data, host = frame.arbitration_id, frame.data, self.objects[0x1016, 1].value >> 16
        try:
            if identifier == Service.NMT:
                self._obey(data)
            elif identifier == Service.SYNC:
                self._sync()
            elif identifier == Service.SDO_REQUEST + self.node_id:
                request = Sdo.unpack(data)
                if request.specifier != ABORTED and self.nmt not in (NmtState.STOPPED, NmtState.BOOT_UP):
                    self._send(Service.SDO_REPLY, self.objects.serve(request).pack())
            elif host and identifier == Service.HEARTBEAT + host:
                unpack_heartbeat(data)
                self._host_beat_ns = now_ns
                if self._host_is_lost:
                    self._host_is_lost = False
                    self.send_emergency(ALL_CLEAR)
            elif self.nmt is NmtState.OPERATIONAL:
                self._receive_pdo(identifier, data)
        except FrameRefusedError:
            self.refused_frames += 1

    def watch(self, now_ns: int) -> None:
        """Check whether the heartbeat that it watches has stopped."""
        wait_ms = self.objects[0x1016, 1].value & 0xFFFF
        if self._host_beat_ns is None or not wait_ms or now_ns - self._host_beat_ns <= wait_ms * _NS_PER_MS:
            return
        self._host_beat_ns = None
        self._host_is_lost = True
        self.send_emergency(HEARTBEAT_LOST)
        if self.nmt is NmtState.OPERATIONAL and self.objects[0x1029, 1].value == 0:
            self.nmt = NmtState.PRE_OPERATIONAL
        self._on_host_lost()

    def send_telemetry(self, now_ns: int) -> None:
        """Send what is due: a boot-up, the heartbeat, and the PDOs that SYNC has asked for."""
        if not self.is_powered:
            return
        if self.nmt is NmtState.BOOT_UP:
            self._send(Service.HEARTBEAT, pack_heartbeat(NmtState.BOOT_UP))
            self.nmt = NmtState.PRE_OPERATIONAL
            self._beat_ns = now_ns
        period_ns = self.objects[0x1017, 0].value * _NS_PER_MS
        if period_ns and now_ns - self._beat_ns >= period_ns:
            self._beat_ns = now_ns
            self._send(Service.HEARTBEAT, pack_heartbeat(self.nmt))
        due, self._due = self._due, []
        for number in due:
            mapped = self.objects.mapped(TPDO_MAPPING + number)
            data = b"".join(entry.value.to_bytes(entry.size, "little") for entry in mapped)
            self._link.send(Frame(self.objects[TPDO + number, 1].value & 0x7FF, data))

    def send_emergency(self, emergency: Emergency) -> None:
        """Report an error, at once, and show it in the error register, 0x1001."""
        if self.is_powered:
            self.objects[0x1001, 0].put(emergency.register)
            self._send(EMERGENCY, emergency.pack())

    def _obey(self, data: bytes) -> None:
        if len(data) != 2 or data[1] not in (0, self.node_id):  # noqa: PLR2004 - a command and a node
            return
        match data[0]:
            case NmtCommand.START:
                self.nmt = NmtState.OPERATIONAL
            case NmtCommand.PRE_OPERATIONAL:
                self.nmt = NmtState.PRE_OPERATIONAL
            case NmtCommand.STOP:
                self._on_host_lost()
                self.nmt = NmtState.STOPPED
            case NmtCommand.RESET_NODE | NmtCommand.RESET_COMMUNICATION:
                self._on_host_lost()
                self.reset(communication_only=data[0] == NmtCommand.RESET_COMMUNICATION)

    def _sync(self) -> None:
        if self.nmt is not NmtState.OPERATIONAL:
            return
        for number, data in self._received.items():
            self._apply(number, data)
        self._received.clear()
        for number in range(PDOS):
            every = self.objects[TPDO + number, 2].value
            if self.objects[TPDO + number, 1].value & NOT_VALID or every not in _SYNCHRONOUS[1:]:
                continue
            self._syncs[number] += 1
            if self._syncs[number] >= every:
                self._syncs[number] = 0
                self._due.append(number)

    def _receive_pdo(self, identifier: int, data: bytes) -> None:
        for number in range(PDOS):
            cob_id = self.objects[RPDO + number, 1].value
            if cob_id & (NOT_VALID | 0x7FF) != identifier:
                continue
            if len(data) != sum(entry.size for entry in self.objects.mapped(RPDO_MAPPING + number)):
                self.refused_frames += 1
            elif self.objects[RPDO + number, 2].value in _SYNCHRONOUS:
                self._received[number] = data
            else:
                self._apply(number, data)

    def _apply(self, number: int, data: bytes) -> None:
        start = 0
        for entry in self.objects.mapped(RPDO_MAPPING + number):
            entry.value = int.from_bytes(data[start : start + entry.size], "little")
            start += entry.size

    def _send(self, service: int, data: bytes) -> None:
        self._link.send(Frame(service + self.node_id, data))


def _communication_defaults(node_id: int) -> dict[Key, ObjectEntry]:
    """The objects of CiA 301 that are used; PDOs exist, switched off and mapped to nothing."""
    objects = {
        (0x1001, 0): ObjectEntry(1, 0, "r"),
        (0x1005, 0): ObjectEntry(4, 0x80),
        (0x1006, 0): ObjectEntry(4),
        (0x1016, 0): ObjectEntry(1, 1, "r"),
        (0x1016, 1): ObjectEntry(4),
        (0x1017, 0): ObjectEntry(2),
        (0x1029, 0): ObjectEntry(1, 1, "r"),
        (0x1029, 1): ObjectEntry(1),
    }
    for number in range(PDOS):
        for base, service in ((RPDO, Service.RPDO1), (TPDO, Service.TPDO1)):
            index = base + number
            objects[index, 0] = ObjectEntry(1, 2, "r")
            objects[index, 1] = ObjectEntry(4, NOT_VALID | (service + 0x100 * number + node_id))
            objects[index, 2] = ObjectEntry(1, 255)
            objects |= {(index + 0x200, place): ObjectEntry(4 if place else 1) for place in range(MAX_MAPPED + 1)}
    return objects
