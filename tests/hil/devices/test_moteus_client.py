# SPDX-License-Identifier: MIT
"""The simulated controllers as the makers' client finds them (PyPI `moteus`), and our commands beside its own."""

import math
from typing import Any

import can
import moteus
import pytest

from segway_ecc.firmware_io.drives.moteus import frames
from segway_ecc.firmware_io.links.link import FD_LENGTHS, Frame
from tests.hil.devices.test_moteus import Bench

Register = moteus.Register


class Client(Bench):
    """The client's encoder and parser of controller 1, without its transports."""

    def __init__(self, query: Any = None) -> None:
        super().__init__()
        resolution = query or moteus.QueryResolution()
        self.make: Any = moteus.Controller(id=1, query_resolution=resolution, transport=object())

    def exchange(self, command: Any, times: int = 1) -> Any:
        """What the client reads in the last answer; None without one."""
        data = bytes(command.data)
        padded = data.ljust(next(length for length in FD_LENGTHS if length >= len(data)), b"\x50")
        identifier = command.reply_required << 15 | command.source << 8 | command.destination
        for _ in range(times):
            self.sent.clear()
            sent = [Frame(identifier, padded, is_extended=identifier > 0x7FF, is_fd=True)]
            self.torques = list(self.drives.obey(sent, 0, self.outputs))
        if not self.sent:
            return None
        (answer,) = self.sent
        message = can.Message(
            arbitration_id=answer.arbitration_id, data=answer.data, is_extended_id=answer.is_extended, is_fd=True
        )
        return command.parse(message)


@pytest.fixture
def client() -> Client:
    return Client()


def torque(client: Client, value: float, *, query: bool = True) -> Any:
    return client.make.make_position(
        position=math.nan,
        velocity=0.0,
        feedforward_torque=value,
        kp_scale=0.0,
        kd_scale=0.0,
        maximum_torque=3.0,
        watchdog_timeout=0.04,
        query=query,
    )


def test_the_client_reads_what_the_controller_measures(client: Client) -> None:
    client.outputs |= {"left.angle": 3.25 * math.tau, "left.velocity": -1.5 * math.tau, "truth.supply_voltage": 24.1}
    client.exchange(torque(client, 0.5), times=20)
    found = client.exchange(torque(client, 0.5))
    assert found.id == 1
    assert found.values[Register.MODE] == moteus.Mode.POSITION
    assert found.values[Register.POSITION] == pytest.approx(3.25)
    assert found.values[Register.VELOCITY] == pytest.approx(-1.5)
    assert found.values[Register.TORQUE] == pytest.approx(0.5)
    assert found.values[Register.VOLTAGE] == 24.0
    assert (found.values[Register.TEMPERATURE], found.values[Register.FAULT]) == (30.0, 0)


@pytest.mark.parametrize(
    ("resolution", "steps"),
    [(moteus.INT8, (0.01, 0.1, 0.5)), (moteus.INT16, (1e-4, 2.5e-4, 0.01)), (moteus.INT32, (1e-5, 1e-5, 1e-3))],
)
def test_the_client_reads_every_integer_with_our_scales(resolution: int, steps: tuple[float, ...]) -> None:
    query: Any = moteus.QueryResolution()
    query.mode = query.position = query.velocity = query.torque = resolution
    query.voltage = query.temperature = query.fault = resolution
    client = Client(query)
    client.outputs |= {"left.angle": 0.75 * math.tau, "left.velocity": -0.9 * math.tau}
    client.exchange(torque(client, 1.5), times=20)
    values = client.exchange(torque(client, 1.5)).values
    for register, value, step in zip((1, 2, 3), (0.75, -0.9, 1.5), steps, strict=True):
        assert values[register] == pytest.approx(value, abs=1.01 * step)
    assert values[Register.VOLTAGE] == pytest.approx(36.0, abs=0.51)
    assert values[Register.MODE] == 10


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ({"position": 0.25}, 1.0),
        ({"position": 0.25, "maximum_torque": 0.4}, 0.4),
        ({"position": 0.25, "kp_scale": 0.5}, 0.5),
        ({"position": math.nan, "velocity": 2.0, "kp_scale": 0.0}, 0.1),
        ({"position": math.nan, "velocity": 2.0, "kp_scale": 0.0, "kd_scale": 0.5, "feedforward_torque": 0.3}, 0.35),
    ],
)
def test_position_commands_of_the_client_are_followed(client: Client, given: dict[str, float], wanted: float) -> None:
    client.exchange(client.make.make_position(**given), times=20)
    assert client.torques[0] == pytest.approx(wanted)


@pytest.mark.parametrize("resolution", [moteus.INT16, moteus.INT32])
def test_commands_of_the_client_in_integers_are_followed(client: Client, resolution: int) -> None:
    form: Any = moteus.PositionResolution()
    form.position = form.velocity = form.feedforward_torque = form.kp_scale = form.kd_scale = resolution
    form.maximum_torque = form.watchdog_timeout = resolution
    client.make.position_resolution = form
    client.exchange(torque(client, 0.5), times=20)
    assert client.torques[0] == pytest.approx(0.5, abs=0.011)
    client.tick(times=39)
    assert client.left.mode == 10
    client.tick(times=2)
    assert client.left.mode == moteus.Mode.TIMEOUT


def test_zero_velocity_and_stop_of_the_client(client: Client) -> None:
    client.outputs["left.velocity"] = 2.0 * math.tau
    client.exchange(client.make.make_zero_velocity(), times=20)
    assert client.torques[0] == pytest.approx(-0.1)
    assert client.exchange(client.make.make_stop(query=True)).values[Register.MODE] == moteus.Mode.ZERO_VELOCITY
    assert client.exchange(client.make.make_query()).values[Register.MODE] == moteus.Mode.STOPPED
    assert client.exchange(client.make.make_stop()) is None


def test_a_time_out_is_shown_to_the_client_until_it_stops_the_controller(client: Client) -> None:
    client.exchange(torque(client, 0.5), times=20)
    client.tick(times=60)
    assert client.exchange(torque(client, 0.5)).values[Register.MODE] == moteus.Mode.TIMEOUT
    client.exchange(client.make.make_stop())
    client.exchange(torque(client, 0.5), times=20)
    assert client.torques[0] == pytest.approx(0.5)


def test_a_fault_is_shown_to_the_client_with_its_number(client: Client) -> None:
    client.exchange(torque(client, 0.5), times=20)
    client.left.fail(33)
    found = client.exchange(client.make.make_query()).values
    assert (found[Register.MODE], found[Register.FAULT]) == (moteus.Mode.FAULT, 33)
    assert frames.fault_name(33) == "motor driver (fault 33)"


def test_the_client_reads_the_configuration_over_the_console(client: Client) -> None:
    assert client.exchange(client.make.make_diagnostic_write(b"conf get servo.timeout_mode\n")) is None
    assert client.exchange(client.make.make_diagnostic_read()).data == b"0.000000\r\n"
    assert client.exchange(client.make.make_diagnostic_read()).data == b""


def test_the_client_reads_our_command_as_it_is_meant() -> None:
    found = moteus.parse_registers(frames.torque_command(0.5, 3.0, 0.04))
    assert math.isnan(found.command.pop(Register.COMMAND_POSITION))
    assert found.command == {
        Register.MODE: moteus.Mode.POSITION,
        Register.COMMAND_VELOCITY: 0.0,
        Register.COMMAND_FEEDFORWARD_TORQUE: 0.5,
        Register.COMMAND_KP_SCALE: 0.0,
        Register.COMMAND_KD_SCALE: 0.0,
        Register.COMMAND_POSITION_MAX_TORQUE: 3.0,
        Register.COMMAND_TIMEOUT: pytest.approx(0.04),
    }
    assert (len(found.query), found.response, found.errors) == (8, {}, [])


@pytest.mark.parametrize("value", [0.5, -1.25, 0.0])
def test_our_torque_is_the_client_s_command_to_the_byte(client: Client, value: float) -> None:
    theirs = bytes(torque(client, value, query=False).data)
    assert frames.torque_command(value, 3.0, 0.04).startswith(theirs)


def test_our_stop_is_the_client_s_command_to_the_byte(client: Client) -> None:
    assert frames.stop_command(0.04).startswith(bytes(client.make.make_stop().data))


def test_our_console_frames_are_the_client_s_to_the_byte(client: Client) -> None:
    assert frames.console_line("conf get id.id") == bytes(client.make.make_diagnostic_write(b"conf get id.id\n").data)
    assert bytes(client.make.make_diagnostic_read(max_length=48).data) == frames.POLL_TEXT


def test_our_question_asks_the_client_s_registers() -> None:
    query = frames.stop_command(0.04)[len(frames.STOP) + 6 :]
    assert moteus.QueryParser.parse(query) == [
        (Register.MODE, moteus.INT8),
        (Register.POSITION, moteus.F32),
        (Register.VELOCITY, moteus.F32),
        (Register.TORQUE, moteus.F32),
        (Register.VOLTAGE, moteus.F32),
        (Register.TEMPERATURE, moteus.INT8),
        (Register.FAULT, moteus.INT8),
        (Register.COMMAND_TIMEOUT, moteus.INT16),
    ]


def test_the_client_and_our_driver_read_one_answer_alike(client: Client) -> None:
    client.outputs |= {"left.angle": 3.25 * math.tau, "left.velocity": -1.5 * math.tau}
    for _ in range(20):
        client.tick(frames.torque_command(0.5, 3.0, 0.04).hex())
    ours = frames.decode_reply(client.sent[0])
    message = can.Message(arbitration_id=0x100, data=client.sent[0].data, is_fd=True, is_extended_id=False)
    theirs = client.make.make_query().parse(message).values
    motion = (Register.MODE, Register.POSITION, Register.VELOCITY, Register.TORQUE)
    registers = (*motion, Register.VOLTAGE, Register.TEMPERATURE, Register.FAULT, Register.COMMAND_TIMEOUT)
    assert ours == pytest.approx(tuple(theirs[register] for register in registers))


def test_names_of_modes_are_those_of_the_client() -> None:
    theirs = {mode.value: mode.name.lower().replace("_", " ") for mode in moteus.Mode}
    differing = {number: (name, theirs[number]) for number, name in enumerate(frames.MODES) if number in theirs}
    for number, (ours, name) in differing.items():
        assert ours.lower().replace(" ", "").startswith(name.replace(" ", "")[:4]), number
