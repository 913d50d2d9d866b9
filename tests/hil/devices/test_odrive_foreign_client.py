# SPDX-License-Identifier: MIT
"""The simulated ODrive as PyPI's odrive-can finds it: its own encoder and decoder of 0.6.10, without its threads."""

import struct
from typing import Any

import can
import pytest
from odrive_can.odrive import CanMsg, ODriveCAN

from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.odrive import Release
from tests.hil.devices.odrive_bench import CLOSED, IDLE, Bench


class Bus:
    """What the client sends reaches the drives in a tick of its own; what they send, it decodes."""

    channel_info = "test"

    def __init__(self) -> None:
        self.bench = Bench("0.6", Release.V0_6_10)
        self.received: list[CanMsg] = []

    def send(self, message: can.Message) -> None:
        self.tick(Frame(message.arbitration_id, bytes(message.data), is_remote=message.is_remote_frame))

    def tick(self, *frames: Frame, times: int = 1) -> None:
        for frame in self.bench.tick(*frames, times=times):
            message = can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=False)
            self.received.append(CanMsg(message))

    def shutdown(self) -> None: ...

    def newest(self, name: str, axis: int = 1) -> dict[str, Any]:
        """The newest message of a name from an axis."""
        data: dict[str, Any] = [each.data for each in self.received if (each.name, each.axis_id) == (name, axis)][-1]
        return data


@pytest.fixture
def bus() -> Bus:
    return Bus()


@pytest.fixture
def client(bus: Bus) -> ODriveCAN:
    stand_in: Any = bus
    found = ODriveCAN(1, stand_in)
    bus.tick()
    return found


def arm(bus: Bus, client: Any) -> None:
    client.set_controller_mode("TORQUE_CONTROL", "PASSTHROUGH")
    client.set_input_torque(0.0)
    client.clear_errors()
    client.set_axis_state_no_wait("CLOSED_LOOP_CONTROL")
    bus.tick(times=20)


def test_the_clients_commands_arm_drive_and_disarm_its_axis(bus: Bus, client: Any) -> None:
    arm(bus, client)
    assert bus.bench.right.state is CLOSED
    assert bus.newest("Heartbeat")["Axis_State"] == "CLOSED_LOOP_CONTROL"
    client.set_input_torque(0.75)
    bus.tick(times=10)
    assert bus.bench.torques == pytest.approx([0.0, -1.5])
    assert bus.newest("Get_Torques")["Torque_Estimate"] == pytest.approx(0.75)
    client.set_axis_state_no_wait("IDLE")
    bus.tick(times=30)
    assert (bus.bench.right.state, bus.bench.left.state) == (IDLE, IDLE)
    assert bus.newest("Heartbeat")["Axis_State"] == "IDLE"


def test_the_client_names_the_error_of_a_limit_that_it_set(bus: Bus, client: Any) -> None:
    arm(bus, client)
    client.set_limits(2.0, 10.0)
    bus.bench.outputs["right.velocity"] = -20.0  # 6.4 turns of the motor a second
    bus.tick(times=25)
    assert bus.newest("Heartbeat")["Axis_Error"] == "VELOCITY_LIMIT_VIOLATION"
    client._send_message("Get_Error", rtr=True)
    assert bus.newest("Get_Error") == {"Active_Errors": "NONE", "Disarm_Reason": "VELOCITY_LIMIT_VIOLATION"}
    client.set_input_torque(0.0)
    client.clear_errors()
    client._send_message("Get_Error", rtr=True)
    assert bus.newest("Get_Error") == {"Active_Errors": "NONE", "Disarm_Reason": "NONE"}


def test_the_client_reads_estimates_version_and_an_endpoint(bus: Bus, client: Any) -> None:
    bus.bench.outputs["right.velocity"] = -12.566370614359172
    client._send_message("Get_Encoder_Estimates", rtr=True)
    assert bus.newest("Get_Encoder_Estimates") == pytest.approx({"Pos_Estimate": 0.0, "Vel_Estimate": 4.0})
    client._send_message("Get_Version", rtr=True)
    version = bus.newest("Get_Version")
    assert [version[f"Fw_Version_{part}"] for part in ("Major", "Minor", "Revision")] == [0, 6, 10]
    client.set_limits(3.5, 10.0)
    client._send_message("RxSdo", {"Opcode": 0, "Endpoint_ID": 388})
    reply = bus.newest("TxSdo")
    assert (reply["Endpoint_ID"], reply["Value"]) == (388, struct.unpack("<I", struct.pack("<f", 3.5))[0])
