# SPDX-License-Identifier: MIT
"""The objects of a CiA 402 drive that the host uses, as the canopen library wants them."""

from typing import Final

from canopen import ObjectDictionary
from canopen.objectdictionary import ODArray, ODRecord, ODVariable
from canopen.objectdictionary.datatypes import INTEGER8, INTEGER16, INTEGER32, UNSIGNED8, UNSIGNED16, UNSIGNED32

_VARIABLES: Final = {
    0x1000: ("device type", UNSIGNED32),
    0x1005: ("COB-ID of SYNC", UNSIGNED32),
    0x1006: ("communication cycle period", UNSIGNED32),
    0x1017: ("producer heartbeat time", UNSIGNED16),
    0x6007: ("abort connection option code", INTEGER16),
    0x6040: ("controlword", UNSIGNED16),
    0x6041: ("statusword", UNSIGNED16),
    0x605A: ("quick stop option code", INTEGER16),
    0x6060: ("modes of operation", INTEGER8),
    0x6061: ("modes of operation display", INTEGER8),
    0x6064: ("position actual value", INTEGER32),
    0x606C: ("velocity actual value", INTEGER32),
    0x6071: ("target torque", INTEGER16),
    0x6076: ("motor rated torque", UNSIGNED32),
    0x6077: ("torque actual value", INTEGER16),
    0x6079: ("DC link circuit voltage", UNSIGNED32),
}
_READ_ONLY: Final = frozenset({0x1000, 0x6041, 0x6061, 0x6064, 0x606C, 0x6077, 0x6079})
_PDO_COMMUNICATION: Final = {
    0x1400: "RPDO1",
    0x1800: "TPDO1",
    0x1801: "TPDO2",
    0x1802: "TPDO3",
    0x1803: "TPDO4",
}
_MAPPING_OFFSET: Final = 0x200
_MAX_MAPPED: Final = 8


def object_dictionary() -> ObjectDictionary:
    """A dictionary of its own for one node."""
    dictionary = ObjectDictionary()  # type: ignore[no-untyped-call]  # canopen's
    for index, (name, data_type) in _VARIABLES.items():
        dictionary.add_object(_variable(name, index, 0, data_type, "ro" if index in _READ_ONLY else "rw"))
    consumer_heartbeat = ODArray("consumer heartbeat time", 0x1016)
    consumer_heartbeat.add_member(_variable("number of entries", 0x1016, 0, UNSIGNED8, "ro"))
    consumer_heartbeat.add_member(_variable("time", 0x1016, 1, UNSIGNED32))
    dictionary.add_object(consumer_heartbeat)
    for index, name in _PDO_COMMUNICATION.items():
        communication = ODRecord(f"{name} communication", index)
        communication.add_member(_variable("highest sub-index", index, 0, UNSIGNED8, "ro"))
        communication.add_member(_variable("COB-ID", index, 1, UNSIGNED32))
        communication.add_member(_variable("transmission type", index, 2, UNSIGNED8))
        mapping = ODRecord(f"{name} mapping", index + _MAPPING_OFFSET)
        mapping.add_member(_variable("number of objects", mapping.index, 0, UNSIGNED8))
        for subindex in range(1, _MAX_MAPPED + 1):
            mapping.add_member(_variable(f"object {subindex}", mapping.index, subindex, UNSIGNED32))
        dictionary.add_object(communication)
        dictionary.add_object(mapping)
    return dictionary


def _variable(name: str, index: int, subindex: int, data_type: int, access: str = "rw") -> ODVariable:
    variable = ODVariable(name, index, subindex)
    variable.data_type = data_type
    variable.access_type = access
    return variable
