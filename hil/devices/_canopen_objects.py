# SPDX-License-Identifier: MIT
"""The object dictionary of a simulated CANopen node, and the SDO server in front of it (CiA 301)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from segway_ecc.firmware_io.drives.cia402.frames import Sdo

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
    NO_SUBINDEX: Final = 0x06090011
    STATE: Final = 0x08000022


class SdoAbortError(Exception):
    """A request that the dictionary does not grant.

    Attributes:
        code: The SDO abort code.
    """

    def __init__(self, code: int) -> None:
        """Keep the code."""
        self.code = code
        super().__init__(f"0x{code:08X}")


@dataclass(slots=True)
class ObjectEntry:
    """An object: its value as an unsigned number of `size` bytes, and what may be done with it."""

    size: int
    value: int = 0
    access: str = "rw"
    mappable: bool = False

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
