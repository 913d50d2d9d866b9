# SPDX-License-Identifier: MIT
"""A CANopen node as CiA 301 defines it: object dictionary, SDO server, NMT, heartbeats, PDOs on SYNC."""

from collections.abc import Callable, Mapping
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
from segway_ecc.hil.devices._canopen_objects import (
    ABORTED,
    MAX_MAPPED,
    NOT_VALID,
    PDOS,
    RPDO,
    RPDO_MAPPING,
    TPDO,
    TPDO_MAPPING,
    Key,
    ObjectDictionary,
    ObjectEntry,
)

_SYNCHRONOUS: Final = range(241)
_NS_PER_MS: Final = 1_000_000

HEARTBEAT_LOST: Final = Emergency(0x8130, 0x11)
"""Error register: generic, and communication."""
ALL_CLEAR: Final = Emergency(0, 0)


class CanopenSlave:
    """One node. What it does beyond communicating is the business of whoever owns it, through `objects`.

    Attributes:
        objects: The object dictionary.
        nmt: The state of its communication.
        refused_frames: Frames for it that it could not use since power-on.
        is_powered: Whether it takes and sends anything.
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
        """Report an error, at once."""
        if self.is_powered:
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
