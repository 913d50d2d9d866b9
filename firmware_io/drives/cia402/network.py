# SPDX-License-Identifier: MIT
"""The canopen library on one of our links, with the objects of a CiA 402 drive that the host uses.

Its waiting calls pump the link, on the loop's clock, without any thread.
"""

import contextlib
import logging
from collections import Counter
from collections.abc import Callable
from typing import Final

import canopen
from canopen import ObjectDictionary
from canopen.objectdictionary import ODArray, ODRecord, ODVariable
from canopen.objectdictionary.datatypes import INTEGER8, INTEGER16, INTEGER32, UNSIGNED8, UNSIGNED16, UNSIGNED32
from canopen.sdo.client import SdoClient

from segway_ecc.firmware_io.drives.cia402.frames import NmtState, Service, is_answer, unpack_heartbeat
from segway_ecc.firmware_io.drives.cia402.settings import ANSWER_WITHIN_NS
from segway_ecc.firmware_io.drives.cia402.wheel import Exchange
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame, Link

_PUMP_NS: Final = 1_000_000
_SDO_LENGTH: Final = 8
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
    0x6072: ("max torque", UNSIGNED16),
    0x6076: ("motor rated torque", UNSIGNED32),
    0x6077: ("torque actual value", INTEGER16),
    0x6079: ("DC link circuit voltage", UNSIGNED32),
    0x6080: ("max motor speed", UNSIGNED32),
    0x6502: ("supported drive modes", UNSIGNED32),
}
_PDO_COMMUNICATION: Final = {
    0x1400: "RPDO1",
    0x1800: "TPDO1",
    0x1801: "TPDO2",
    0x1802: "TPDO3",
    0x1803: "TPDO4",
}
_MAPPING_OFFSET: Final = 0x200
_MAX_MAPPED: Final = 8
_IDENTITY_PARTS: Final = 4
"""Vendor, product, revision, serial number."""

# The library logs every step of a set-up; failures reach us as exceptions, and are logged once.
logging.getLogger("canopen").setLevel(logging.CRITICAL)


class LinkNetwork(canopen.Network):
    """A CANopen network for the time of the set-up; it blocks, so it is used before the loop starts, never within it.

    What waits takes frames from the link and lets a millisecond pass on the injected clock, in turns: on the robot that
    sleeps, in lock step the simulated devices run meanwhile. Frames that are no SDO answers or heartbeats are lost to
    everybody else who listens on the link: acceptable, since nobody needs them before the first cycle.

    Attributes:
        boots: How often each node has reported that it started, by node id.
        exchanges: The SDO requests that were answered, with their answers, by node id.
        refused: SDO answers that were discarded, since nothing was asked that they answer.
    """

    def __init__(self, link: Link, now_ns: Callable[[], int], sleep_until_ns: Callable[[int], None]) -> None:
        """Speak over `link`, which is open."""
        super().__init__()
        self.boots: Counter[int] = Counter()
        self.exchanges: dict[int, list[Exchange]] = {}
        self.refused = 0
        self.link = link
        self.now_ns = now_ns
        self._sleep_until_ns = sleep_until_ns
        self._asked: dict[int, bytes] = {}

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:  # noqa: FBT001, FBT002 - the library's
        """Send a frame; `canopen.SdoCommunicationError` where the link has no room for it."""
        frame = Frame(can_id, bytes(data), is_remote=remote)
        if Service.SDO_REQUEST < can_id < Service.HEARTBEAT:
            self._asked[can_id - Service.SDO_REQUEST] = frame.data
        if not self.link.send(frame):
            raise canopen.SdoCommunicationError(f"{self.link.description} does not take frames")

    def wait_until(self, happened: Callable[[], bool], within_ns: int = ANSWER_WITHIN_NS) -> bool:
        """Take frames until something has happened, and whether it has in that time; LinkLostError for a lost link."""
        deadline_ns = self.now_ns() + within_ns
        while not happened():
            if self.now_ns() >= deadline_ns:
                return False
            self._sleep_until_ns(self.now_ns() + _PUMP_NS)
            for frame in self.link.receive():
                self._take(frame)
        return True

    def _take(self, frame: Frame) -> None:
        identifier = frame.arbitration_id
        if frame.is_extended:
            return
        if Service.SDO_REPLY < identifier < Service.SDO_REQUEST and len(frame.data) == _SDO_LENGTH:
            node_id = identifier - Service.SDO_REPLY
            request = self._asked.get(node_id)
            if request is None or not is_answer(request, frame.data):
                self.refused += 1  # of a stranger, or late; the answer that is waited for is yet to come
                return
            self._keep(node_id, frame.data)
            self.notify(identifier, bytearray(frame.data), frame.received_ns * 1e-9)
        elif identifier > Service.HEARTBEAT:
            with contextlib.suppress(FrameRefusedError):  # a damaged heartbeat is no boot-up
                self.boots[identifier - Service.HEARTBEAT] += unpack_heartbeat(frame.data) is NmtState.BOOT_UP

    def _keep(self, node_id: int, answer: bytes) -> None:
        """Keep a request with its answer; of the same request made several times, the last answer."""
        request = self._asked.pop(node_id, None)
        if request is None:
            return
        exchanges = self.exchanges.setdefault(node_id, [])
        if exchanges and exchanges[-1].request == request:
            exchanges.pop()
        exchanges.append(Exchange(request, answer))


class PumpedNode(canopen.RemoteNode):
    """A node whose SDO client waits by pumping the link."""

    network: LinkNetwork

    def add_sdo(self, rx_cobid: int, tx_cobid: int) -> SdoClient:
        """See `canopen.RemoteNode.add_sdo`, which calls it while the node is made; later it must not be called."""
        client = _PumpedSdoClient(rx_cobid, tx_cobid, self.object_dictionary)  # type: ignore[no-untyped-call]  # canopen's
        self.sdo_channels.append(client)
        return client


class _PumpedSdoClient(SdoClient):
    network: LinkNetwork

    def read_response(self) -> bytes:
        """Wait for an answer; see `SdoClient.read_response`, which then finds it in its queue."""
        if not self.network.wait_until(lambda: not self.responses.empty()):
            raise canopen.SdoCommunicationError("no answer")
        return bytes(super().read_response())  # type: ignore[no-untyped-call]  # canopen's


def object_dictionary() -> ObjectDictionary:
    """A dictionary of its own for one node."""
    dictionary = ObjectDictionary()  # type: ignore[no-untyped-call]  # canopen's
    for index, (name, data_type) in _VARIABLES.items():
        dictionary.add_object(_variable(name, index, 0, data_type))
    dictionary.add_object(_filled(ODArray("consumer heartbeat time", 0x1016), UNSIGNED8, UNSIGNED32))
    dictionary.add_object(_filled(ODRecord("identity", 0x1018), UNSIGNED8, *(UNSIGNED32,) * _IDENTITY_PARTS))
    dictionary.add_object(_filled(ODRecord("interpolation time period", 0x60C2), UNSIGNED8, UNSIGNED8, INTEGER8))
    for index, name in _PDO_COMMUNICATION.items():
        dictionary.add_object(_filled(ODRecord(f"{name} communication", index), UNSIGNED8, UNSIGNED32, UNSIGNED8))
        mapping = ODRecord(f"{name} mapping", index + _MAPPING_OFFSET)
        dictionary.add_object(_filled(mapping, UNSIGNED8, *(UNSIGNED32,) * _MAX_MAPPED))
    return dictionary


def _filled(group: ODArray | ODRecord, *data_types: int) -> ODArray | ODRecord:
    """With a member of each type from sub-index 0 on, which counts the others."""
    for subindex, data_type in enumerate(data_types):
        group.add_member(_variable(f"{group.name} {subindex}", group.index, subindex, data_type))
    return group


def _variable(name: str, index: int, subindex: int, data_type: int) -> ODVariable:
    variable = ODVariable(name, index, subindex)
    variable.data_type = data_type
    return variable
