# SPDX-License-Identifier: MIT
"""However the model node ends, the last command on the bus is zero with the motors off."""

import importlib.resources
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import cantools
import pytest

from segway_ecc.firmware_io.links.local_bus import LocalBus
from segway_ecc.hil.process_usage import helpers_of
from segway_ecc.node.config import read_text
from tests.patience import PATIENCE_S

pytestmark = [pytest.mark.ros, pytest.mark.real_time]

Start = Callable[..., "subprocess.Popen[str]"]
BOARD = importlib.resources.files("segway_ecc.firmware_io") / "drives" / "wheel_board"
DBC = cantools.database.load_string((BOARD / "wheel_board.dbc").read_text("utf-8"), "dbc")
COMMAND = DBC.get_message_by_name("RIGHT_COMMAND")
"""The frame that completes a command."""
FAILING_MODEL = """
from segway_ecc.node.models.cart import CartController


class Failing(CartController):
    count = 0

    def step(self, u):
        self.count += 1
        if self.count == 150:
            raise ZeroDivisionError("the axle broke")
        return super().step(u)
"""


@pytest.fixture(scope="module")
def channel() -> str:
    return f"shutdown_{os.getpid()}"


@pytest.fixture(scope="module", autouse=True)
def plant(start_for_all: Start, channel: str) -> None:
    start_for_all("plant", "plant", "cart-can", "--interface", "local", "--channel", channel)


@pytest.fixture
def witness(channel: str) -> Iterator[can.BusABC]:
    """A third participant of the bus."""
    with LocalBus(channel) as bus:
        yield bus


@pytest.fixture
def manoeuvre(tmp_path: Path) -> str:
    """A sequence that would go on for a minute."""
    path = tmp_path / "long.yaml"
    path.write_text("segments:\n  - {linear: 1.0, angular: 0.5, duration: 60}\n", "utf-8")
    return str(path)


def command_of(arbitration_id: int, data: bytes) -> dict[str, Any] | None:
    if arbitration_id != COMMAND.frame_id:
        return None
    decoded = COMMAND.decode(data)
    return {name: decoded[name] for name in ("Voltage", "Enable")}


def wait_for_command(bus: can.BusABC, wanted: Callable[[dict[str, Any]], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        message = bus.recv(0.1)
        command = None if message is None else command_of(message.arbitration_id, bytes(message.data))
        if command is not None and wanted(command):
            return
    pytest.fail("the wanted command never came")


def last_command(bus: can.BusABC, node: "subprocess.Popen[str]") -> dict[str, Any]:
    """The last command that a node sends; the bus is read all the while, so that nothing overflows."""
    deadline_s = time.monotonic() + PATIENCE_S
    last: dict[str, Any] | None = None
    ended_at_s: float | None = None
    while time.monotonic() < deadline_s:
        message = bus.recv(0.02)
        if message is not None:
            last = command_of(message.arbitration_id, bytes(message.data)) or last
            # The plant never stops talking: what it sends long after the node's end follows all that the node sent.
            if ended_at_s is not None and message.timestamp > ended_at_s:
                break
        if ended_at_s is None and node.poll() is not None:
            ended_at_s = time.time()
    assert ended_at_s is not None, "the node did not end"
    assert last is not None
    return last


ZERO = {"Voltage": 0.0, "Enable": 0}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_driving_robot_with_zero_and_exit_code_0(  # noqa: PLR0913, PLR0917 - pytest's fixtures
    start: Start, messages: Path, witness: can.BusABC, channel: str, manoeuvre: str, number: signal.Signals
) -> None:
    bus = ["--interface", "local", "--channel", channel]
    node = start(f"node.{number}", "run", "cart-can", *bus, "--no-ros", "--no-log", "--sequence", manoeuvre)
    wait_for_command(witness, lambda command: command["Enable"] == 1 and command["Voltage"] > 0.5)
    node.send_signal(number)

    assert last_command(witness, node) == ZERO
    assert node.wait(PATIENCE_S) == 0
    assert f"segway-ecc: stopped: {number.name}" in (messages / f"node.{number}.txt").read_text().splitlines()


def test_a_signal_ends_a_robot_on_ros_the_same_way(
    start: Start, messages: Path, witness: can.BusABC, channel: str
) -> None:
    node = start("ros", "run", "cart-can", "--interface", "local", "--channel", channel, "--ros", "--no-log")
    wait_for_command(witness, lambda command: command["Enable"] == 1)
    node.send_signal(signal.SIGINT)

    assert last_command(witness, node) == ZERO
    assert node.wait(PATIENCE_S) == 0
    assert (messages / "ros.txt").read_text().splitlines()[-1] == "segway-ecc: stopped: SIGINT"


def test_a_model_that_raises_ends_the_robot_with_zero_and_exit_code_3(  # noqa: PLR0913, PLR0917 - pytest's fixtures
    start: Start, messages: Path, witness: can.BusABC, channel: str, manoeuvre: str, tmp_path: Path
) -> None:
    (tmp_path / "failing_model.py").write_text(FAILING_MODEL, "utf-8")
    packaged = read_text("cart-can")
    robot = tmp_path / "failing.yaml"
    robot.write_text(packaged.replace("segway_ecc.node.models.cart:CartController", "failing_model:Failing"), "utf-8")
    words = ["run", str(robot), "--interface", "local", "--channel", channel, "--no-ros", "--no-log"]
    node = start("failing", *words, "--sequence", manoeuvre, env={"PYTHONPATH": str(tmp_path)})
    wait_for_command(witness, lambda command: command["Enable"] == 1 and command["Voltage"] > 0.5)

    assert last_command(witness, node) == ZERO
    assert node.wait(PATIENCE_S) == 3
    lines = (messages / "failing.txt").read_text().splitlines()
    told = r"segway-ecc: model '[\w-]+' failed in cycle \d+ while running: ZeroDivisionError: the axle broke \("
    assert re.match(told, lines[-1])
    assert "failing_model.py:" in lines[-1]
    assert [line for line in lines if not line.startswith("segway-ecc: ")] == []


def ros_process_of(node: "subprocess.Popen[str]") -> int:
    """A node's ROS process."""
    return helpers_of(node.pid)["ros"]


def wait_for_message(path: Path, wanted: str) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        if wanted in path.read_text():
            return
        time.sleep(0.05)
    pytest.fail(f"it never printed: {wanted}")


def test_a_robot_whose_ros_dies_goes_on_while_it_is_armed(
    start: Start, messages: Path, witness: can.BusABC, channel: str
) -> None:
    node = start("alone", "run", "cart-can", "--interface", "local", "--channel", channel, "--ros", "--no-log")
    wait_for_command(witness, lambda command: command["Enable"] == 1)
    os.kill(ros_process_of(node), signal.SIGKILL)
    wait_for_message(messages / "alone.txt", "the ROS process has ended with status -9")
    while witness.recv(0.0) is not None:
        pass
    wait_for_command(witness, lambda command: command["Enable"] == 1)

    assert node.poll() is None
    node.send_signal(signal.SIGTERM)
    assert last_command(witness, node) == ZERO
    assert node.wait(PATIENCE_S) == 0


def test_a_robot_whose_ros_dies_while_it_is_disarmed_is_in_ros_again(
    start: Start, messages: Path, on_request: str, foreign: Callable[..., Any]
) -> None:
    node = start("disarmed", "run", on_request, "--ros", "--no-log", "--namespace", "/disarmed")
    assert foreign("wait_for", node="model", namespace="/disarmed")
    first = ros_process_of(node)
    os.kill(first, signal.SIGKILL)
    wait_for_message(messages / "disarmed.txt", "the robot is in ROS again")
    assert ros_process_of(node) != first
    deadline_s = time.monotonic() + PATIENCE_S
    # Seen are the dead one's services at first, which never answer.
    while not (answer := foreign("call", service="/disarmed/model/arm", within_s=3.0)):
        assert time.monotonic() < deadline_s
    assert answer[0] is True
    assert node.poll() is None
    node.send_signal(signal.SIGTERM)
    assert node.wait(PATIENCE_S) == 0


def test_a_robot_that_is_killed_takes_its_ros_along(start: Start, messages: Path, on_request: str) -> None:
    node = start("killed", "run", on_request, "--ros", "--no-log")
    wait_for_message(messages / "killed.txt", "runs at")
    speaker = Path(f"/proc/{ros_process_of(node)}/cmdline")
    node.kill()
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s and speaker.exists() and speaker.read_bytes():
        time.sleep(0.05)

    assert not speaker.exists() or not speaker.read_bytes()
