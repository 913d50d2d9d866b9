# SPDX-License-Identifier: MIT
"""The simulated drives as the canopen library finds them: its own client, PDOs and state machine, without a thread."""

from typing import Any

import canopen
import pytest
from canopen import BaseNode402, SdoAbortedError
from canopen.objectdictionary import ODVariable
from canopen.objectdictionary.datatypes import UNSIGNED32

from segway_ecc.firmware_io.drives.cia402.network import object_dictionary
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings, Cia402WheelSettings
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState
from segway_ecc.hil.devices.cia402 import SimulatedCia402
from tests.hil.devices.cia402_faults import latch_fault

SETTINGS = Cia402Settings(
    axes={
        "left": Cia402WheelSettings(node_id=4, counts_per_turn=4000, max_torque=5.0),
        "right": Cia402WheelSettings(node_id=9, counts_per_turn=4000, max_torque=5.0),
    },
)


class Bus(canopen.Network):
    """What the library sends reaches the drives in a tick of its own, and their answers the library before it waits."""

    description = "test"
    state = LinkState.ACTIVE
    counters = LinkCounters()

    def __init__(self) -> None:
        super().__init__()
        self.now_ns = 0
        self.outputs = dict.fromkeys(("left.angle", "left.velocity", "right.angle", "right.velocity"), 0.0)
        link: Any = self
        self.drives = SimulatedCia402(link, SETTINGS)
        self.torques: tuple[float, ...] = ()

    def send(self, frame: Frame) -> bool:
        """The drives' way to the library."""
        self.notify(frame.arbitration_id, bytearray(frame.data), self.now_ns * 1e-9)
        return True

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:  # noqa: FBT001, FBT002, ARG002 - the library's
        self.tick(Frame(can_id, bytes(data)))

    def tick(self, *frames: Frame) -> None:
        self.now_ns += 1_000_000
        self.torques = tuple(self.drives.obey(frames, self.now_ns, self.outputs))
        self.drives.send_telemetry(self.now_ns, self.outputs)


@pytest.fixture
def bus() -> Bus:
    return Bus()


@pytest.fixture
def node(bus: Bus) -> BaseNode402:
    dictionary = object_dictionary()
    modes = ODVariable("supported drive modes", 0x6502)
    modes.data_type = UNSIGNED32
    dictionary.add_object(modes)
    found = BaseNode402(4, dictionary)  # type: ignore[no-untyped-call]  # canopen's
    bus.add_node(found)
    bus.tick()
    return found


def test_the_librarys_client_reads_writes_and_gets_abort_codes(node: BaseNode402) -> None:
    assert node.sdo[0x1000].raw == 0x20192
    node.sdo[0x1017].raw = 25
    assert node.sdo[0x1017].raw == 25
    assert node.sdo[0x1016][1].raw == 0
    with pytest.raises(SdoAbortedError, match="read only"):
        node.sdo.download(0x1000, 0, bytes(4))
    with pytest.raises(SdoAbortedError, match="Object does not exist"):
        node.sdo.upload(0x2000, 0)
    with pytest.raises(SdoAbortedError, match="Subindex does not exist"):
        node.sdo.upload(0x1016, 7)
    with pytest.raises(SdoAbortedError, match="length"):
        node.sdo.download(0x1017, 0, bytes(4))


def test_the_librarys_state_machine_takes_it_to_operation_and_back(bus: Bus, node: BaseNode402) -> None:
    assert node.state == "SWITCH ON DISABLED"
    node.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
    assert node.op_mode == "CYCLIC SYNCHRONOUS TORQUE"
    node.state = "OPERATION ENABLED"
    node.sdo[0x6071].raw = 200
    bus.tick()
    assert bus.torques == pytest.approx((0.3, 0.0))
    assert node.sdo[0x6077].raw == 200
    node.state = "SWITCH ON DISABLED"
    assert bus.torques == (0.0, 0.0)


def test_the_library_resets_a_fault(bus: Bus, node: BaseNode402) -> None:
    latch_fault(bus.drives.axes["left"])
    bus.tick()
    assert node.is_faulted()  # type: ignore[no-untyped-call]  # canopen's
    assert [(error.code, error.register) for error in node.emcy.active] == [(0x2310, 3)]
    node.controlword = 0x80
    assert node.state == "SWITCH ON DISABLED"
    assert node.emcy.active == []


def test_pdos_that_the_library_maps_pass_both_ways(bus: Bus, node: BaseNode402) -> None:
    node.rpdo[1].read()
    node.tpdo[1].read()
    command, status = node.rpdo[1], node.tpdo[1]
    command.clear()
    command.add_variable(0x6071)
    command.add_variable(0x6040)
    command.trans_type, command.enabled = 255, True
    status.clear()
    status.add_variable(0x606C)
    status.add_variable(0x6041)
    status.trans_type, status.enabled = 1, True
    command.save()
    status.save()
    node.sdo[0x6060].raw = 10
    node.nmt.state = "OPERATIONAL"
    for controlword in (6, 7, 15):
        command[0x6040].raw, command[0x6071].raw = controlword, -100
        command.transmit()
    bus.outputs["left.velocity"] = 6.283185307179586
    bus.sync.transmit()

    assert bus.torques[0] == pytest.approx(-0.15)
    assert status[0x6041].raw & 0x6F == 0x27
    assert status[0x606C].raw == 4000


def test_the_library_receives_heartbeats_and_boot_ups(bus: Bus, node: BaseNode402) -> None:
    node.sdo[0x1017].raw = 10
    node.nmt.state = "OPERATIONAL"
    states: list[int] = []
    node.nmt.add_heartbeat_callback(states.append)
    for _ in range(10):
        bus.tick()
    assert states == [5]
    node.nmt.state = "RESET"
    assert states == [5, 0]
    assert node.nmt.state == "PRE-OPERATIONAL"
