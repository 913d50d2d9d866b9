"""However the model node ends, the last command on the bus is zero with the motors off."""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import cantools
import pytest

from firmware_io.links.link import Frame
from firmware_io.links.local_bus import LocalBus
from hil.lockstep import LockstepRig
from hil.simulation import simulated_bus, simulated_robot
from node.config import load_robot
from node.cycle.seams import CycleRecord, NoRecorder
from node.robot import build_robot
from node.ros.runtime import ros_node
from node.ros.stage import RosStage

pytestmark = pytest.mark.ros

Start = Callable[..., "subprocess.Popen[str]"]
ROOT = Path(__file__).parents[3]
DBC = cantools.database.load_file(ROOT / "firmware_io/drives/wheel_board/wheel_board.dbc")
WHEEL_COMMAND = DBC.get_message_by_name("WHEEL_COMMAND")
ENDS_WITHIN_S = 30.0
FAILING_MODEL = """
from node.models.cart import CartController


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
def plant(start: Start, channel: str) -> None:
    start("plant", "plant", "cart-can", "--interface", "local", "--channel", channel)


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
    if arbitration_id != WHEEL_COMMAND.frame_id:
        return None
    decoded = WHEEL_COMMAND.decode(data)
    return {name: decoded[name] for name in ("LeftVoltage", "RightVoltage", "Enable")}


def wait_for_command(bus: can.BusABC, wanted: Callable[[dict[str, Any]], bool]) -> None:
    deadline_s = time.monotonic() + ENDS_WITHIN_S
    while time.monotonic() < deadline_s:
        message = bus.recv(0.1)
        command = None if message is None else command_of(message.arbitration_id, bytes(message.data))
        if command is not None and wanted(command):
            return
    pytest.fail("the wanted command never came")


def last_command(bus: can.BusABC, node: "subprocess.Popen[str]") -> dict[str, Any]:
    """The last command that a node sends; the bus is read all the while, so that nothing overflows."""
    deadline_s = time.monotonic() + ENDS_WITHIN_S
    last: dict[str, Any] | None = None
    ended_at_s: float | None = None
    while time.monotonic() < deadline_s:
        message = bus.recv(0.02)
        if message is not None:
            last = command_of(message.arbitration_id, bytes(message.data)) or last
            # The plant never stops talking: what it says long after the node's end follows all that the node said.
            if ended_at_s is not None and message.timestamp > ended_at_s:
                break
        if ended_at_s is None and node.poll() is not None:
            ended_at_s = time.time()
    assert ended_at_s is not None, "the node did not end"
    assert last is not None
    return last


ZERO = {"LeftVoltage": 0.0, "RightVoltage": 0.0, "Enable": 0}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_driving_robot_with_zero_and_exit_code_0(  # noqa: PLR0913, PLR0917 - pytest's fixtures
    start: Start, messages: Path, witness: can.BusABC, channel: str, manoeuvre: str, number: signal.Signals
) -> None:
    bus = ["--interface", "local", "--channel", channel]
    node = start(f"node.{number}", "run", "cart-can", *bus, "--no-ros", "--no-log", "--sequence", manoeuvre)
    wait_for_command(witness, lambda command: command["Enable"] == 1 and command["RightVoltage"] > 0.5)
    node.send_signal(number)

    assert last_command(witness, node) == ZERO
    assert node.wait(ENDS_WITHIN_S) == 0
    assert f"segway-ecc: stopped: {number.name}" in (messages / f"node.{number}.txt").read_text().splitlines()


def test_a_signal_ends_a_robot_on_ros_the_same_way(
    start: Start, messages: Path, witness: can.BusABC, channel: str
) -> None:
    node = start("ros", "run", "cart-can", "--interface", "local", "--channel", channel, "--ros", "--no-log")
    wait_for_command(witness, lambda command: command["Enable"] == 1)
    node.send_signal(signal.SIGINT)

    assert last_command(witness, node) == ZERO
    assert node.wait(ENDS_WITHIN_S) == 0
    assert (messages / "ros.txt").read_text().splitlines()[-1] == "segway-ecc: stopped: SIGINT"


def test_a_model_that_raises_ends_the_robot_with_zero_and_exit_code_3(  # noqa: PLR0913, PLR0917 - pytest's fixtures
    start: Start, messages: Path, witness: can.BusABC, channel: str, manoeuvre: str, tmp_path: Path
) -> None:
    (tmp_path / "failing_model.py").write_text(FAILING_MODEL, "utf-8")
    packaged = (ROOT / "node/robots/cart-can.yaml").read_text("utf-8")
    robot = tmp_path / "failing.yaml"
    robot.write_text(packaged.replace("node.models.cart:CartController", "failing_model:Failing"), "utf-8")
    words = ["run", str(robot), "--interface", "local", "--channel", channel, "--no-ros", "--no-log"]
    node = start("failing", *words, "--sequence", manoeuvre, env={"PYTHONPATH": str(tmp_path)})
    wait_for_command(witness, lambda command: command["Enable"] == 1 and command["RightVoltage"] > 0.5)

    assert last_command(witness, node) == ZERO
    assert node.wait(ENDS_WITHIN_S) == 3
    lines = (messages / "failing.txt").read_text().splitlines()
    assert lines[-1].startswith("segway-ecc: the model failed while running: ZeroDivisionError: the axle broke (")
    assert "failing_model.py:" in lines[-1]
    assert [line for line in lines if not line.startswith("segway-ecc: ")] == []


class ShutsDown(NoRecorder):
    """Shuts ROS down from inside, once the robot is armed and well under way."""

    def __init__(self, context: Any) -> None:
        self._context = context

    def write(self, record: CycleRecord) -> None:
        if record.cycle == 50:
            self._context.try_shutdown()


def test_ros_that_shuts_down_ends_the_loop_with_zero(
    monkeypatch: pytest.MonkeyPatch, ros_environment: dict[str, str]
) -> None:
    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOG_DIR"):
        monkeypatch.setenv(name, ros_environment[name])
    file = load_robot("cart-can")
    rig = LockstepRig(simulated_bus(file).bitrate)
    rig.attach(simulated_robot(file, rig.bus.attach("plant")))
    robot = build_robot(file, rig, rig.bus.attach("node"))
    witness = rig.bus.attach("witness")
    with ros_node("model", "") as node:
        loop = robot.loop(RosStage(node, file.ros, robot.wiring, robot.model, file.name), ShutsDown(node.context))
        # The limit only keeps a loop that goes on from going on for ever.
        loop.run(1000)
    rig.sleep_until_ns(rig.now_ns() + 10_000_000)

    frames: list[Frame] = witness.receive()
    commands = [command for f in frames if (command := command_of(f.arbitration_id, f.data)) is not None]
    assert loop.stop_reason == "ROS has shut down"
    assert loop.counters.cycles == 51
    assert [command["Enable"] for command in commands[-3:]] == [1, 0, 0]
    assert commands[-1] == ZERO
