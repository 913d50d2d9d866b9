# SPDX-License-Identifier: MIT
"""`segway-ecc guard`: the guard as a process of its own, with real processes to guard."""

import contextlib
import json
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest

from segway_ecc.firmware_io.drives.wheel_board.frames import (
    BoardSession,
    BoardState,
    BoardStatus,
    FrameId,
    decode,
    encode,
)
from segway_ecc.firmware_io.drives.wheel_board.session import CommandId
from segway_ecc.firmware_io.heartbeat import BusOwner
from segway_ecc.firmware_io.links.local_bus import LocalBus
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.node import config
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.real_time

Run = Callable[..., Any]
STATUS = 9
DRIVEN = 10
"""Commands to move that are heard before the node is harmed, so that the guard has seen it drive."""
SEQUENCE = "segments: [{linear: 1.0, angular: 0.5, duration: 60.0}]"


def one_line(outcome: Any) -> str:
    assert outcome.out == ""
    (line,) = outcome.errors
    assert line.startswith("segway-ecc: ")
    return str(line)


def test_a_robot_that_is_all_model_has_nothing_to_guard(segway_ecc: Run) -> None:
    outcome = segway_ecc("guard", "cart")

    assert outcome.code == 2
    assert one_line(outcome) == "segway-ecc: robot 'cart' has no drives: there is nothing to guard"


@pytest.mark.parametrize("limit", ["0.009", "0.21", "-1"])
def test_a_limit_out_of_range_is_refused(segway_ecc: Run, limit: str) -> None:
    outcome = segway_ecc("guard", "cart-can", "--limit", limit)

    assert outcome.code == 2
    assert one_line(outcome) == "segway-ecc: --limit must be from 0.01 to 0.2 s"


def test_a_bus_that_is_not_there_is_reported(segway_ecc: Run) -> None:
    outcome = segway_ecc("guard", "cart-can", "--interface", "socketcan", "--channel", "nosuch0")

    assert outcome.code == 4
    assert one_line(outcome).startswith("segway-ecc: no CAN interface is called 'nosuch0'; ")


class Processes:
    """Our commands on a virtual bus of this test's own."""

    def __init__(self, stack: contextlib.ExitStack, name: str) -> None:
        self.channel = f"{name}_{os.getpid()}"
        self.bus = stack.enter_context(LocalBus(self.channel))
        self._stack = stack

    def start(self, verb: str, *words: str, robot: str = "cart-can") -> "subprocess.Popen[str]":
        command = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", verb, robot, "--interface", "local"]
        started = subprocess.Popen(
            [*command, "--channel", self.channel, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self._stack.callback(_end, started)
        return started

    def wait_for(self, wanted: Callable[[can.Message], bool]) -> can.Message:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            message = self.bus.recv(1.0)
            if message is not None and wanted(message):
                return message
        pytest.fail("it did not come")

    def heard_within(self, seconds: float) -> list[can.Message]:
        deadline, heard = time.monotonic() + seconds, []
        while time.monotonic() < deadline:
            message = self.bus.recv(0.05)
            if message is not None:
                heard.append(message)
        return heard


def _end(process: "subprocess.Popen[str]") -> None:
    if process.poll() is None:
        process.kill()
    process.communicate()


@pytest.fixture
def processes(request: pytest.FixtureRequest) -> Iterator[Processes]:
    with contextlib.ExitStack() as stack:
        yield Processes(stack, request.node.name[:20])


def ended(process: "subprocess.Popen[str]") -> tuple[dict[str, Any], list[str]]:
    process.send_signal(signal.SIGINT)
    out, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    return json.loads(out), errors.splitlines()


def is_state(message: can.Message, state: BoardState) -> bool:
    if message.arbitration_id != FrameId.BOARD_STATUS:
        return False
    payload, _ = decode(message.arbitration_id, bytes(message.data))
    return isinstance(payload, BoardStatus) and payload.state is state


def is_command(message: can.Message, *, enable: bool) -> bool:
    return message.arbitration_id == CommandId.RIGHT_COMMAND and bool(message.data[3] & 0x80) is enable


def current_for(message: can.Message) -> float | None:
    """The motor current, A, that a VESC is told: command 1 of its protocol, in mA."""
    if not message.is_extended_id or message.arbitration_id >> 8 != 1:
        return None
    (milliamperes,) = struct.unpack(">i", message.data)
    return float(milliamperes) * 1e-3


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_node_that_dies_or_hangs_is_followed_by_zeros(
    processes: Processes, tmp_path: Path, number: signal.Signals
) -> None:
    """In this order on the bus: the last torque, then zeros for both wheels, for a second.

    On VESC, where the guard acts however soon the drive's own time-out does, so that a busy machine changes nothing.
    """
    sequence = tmp_path / "sequence.yaml"
    sequence.write_text(SEQUENCE, "utf-8")
    processes.start("plant", robot="cart-vesc")
    guard = processes.start("guard", "--json", robot="cart-vesc")
    processes.wait_for(lambda m: m.is_extended_id and m.arbitration_id >> 8 == STATUS)
    node = processes.start("run", "--no-ros", "--no-log", "--sequence", str(sequence), robot="cart-vesc")
    for _ in range(DRIVEN):
        processes.wait_for(lambda m: abs(current_for(m) or 0.0) > 0.5)
    node.send_signal(number)
    heard = processes.heard_within(2.0)
    last = max((i for i, m in enumerate(heard) if current_for(m)), default=-1)
    zeros = [m for m in heard[last + 1 :] if current_for(m) == 0.0]
    report, errors = ended(guard)

    assert {m.arbitration_id & 0xFF for m in zeros} == {1, 2}
    assert len(zeros) > 20
    assert report["intervened"] >= 1
    done = report["interventions"][-1]
    assert done["cause"] == "the node's heartbeats stopped"
    assert done["end"] == "the time for it is over"
    # The limit is 30 ms from the last heartbeat; one that dies just before its heartbeat sent that 10 ms ago.
    assert done["reaction_ms"] > 20.0
    assert done["first_stop_wall_ns"] > done["last_heartbeat_wall_ns"]
    assert done["frames"] > 20
    assert report["limit_s"] == 0.03
    assert report["frames"] > report["commands"] > 0
    assert report["heartbeats"] > 0
    assert report["longest_gap_ms"] > 0.0
    assert errors[-1].startswith("segway-ecc: stopped the drives: the node's heartbeats stopped; ")


def test_start_arming_and_a_normal_stop_are_left_alone(processes: Processes) -> None:
    """With a limit that a busy machine keeps too: what is shown is the order of things, not their speed."""
    guard = processes.start("guard", "--json", "--limit", "0.2")
    processes.start("plant")
    for _ in range(2):
        node = processes.start("run", "--no-ros", "--no-log")
        processes.wait_for(lambda m: is_state(m, BoardState.ENABLED))
        processes.heard_within(0.3)
        node.send_signal(signal.SIGINT)
        node.communicate(timeout=PATIENCE_S)
        assert node.returncode == 0
        processes.heard_within(0.5)  # what the board said before is not taken for the next node's
    report, errors = ended(guard)

    assert report["interventions"] == []
    assert report["intervened"] == 0
    assert report["heartbeats"] > 0
    assert [line for line in errors if "priority" not in line] == [
        f"segway-ecc: guard on local {processes.channel}",
    ]


def test_heartbeats_keep_it_quiet_while_the_board_only_announced_its_session(processes: Processes) -> None:
    guard = processes.start("guard", "--limit", "0.2")
    beats = BusOwner(CanSettings(interface="local", channel=processes.channel))
    assert guard.stderr is not None
    while "guard on" not in guard.stderr.readline():
        pass
    with contextlib.closing(beats):
        beats.open()
        data = encode(FrameId.BOARD_SESSION, BoardSession(1, 0), 0)
        processes.bus.send(can.Message(arbitration_id=FrameId.BOARD_SESSION, data=data, is_extended_id=False))
        for _ in range(50):
            beats.beat(is_on=True)
            assert processes.heard_within(0.01) == []
    stopping = processes.heard_within(1.0)
    guard.send_signal(signal.SIGTERM)
    out, _ = guard.communicate(timeout=PATIENCE_S)

    assert stopping
    assert not any(is_command(m, enable=True) for m in stopping)
    assert guard.returncode == 0
    lines = dict(line.split(None, 1) for line in out.splitlines())
    assert lines["intervened"].strip() == "1"
    assert int(lines["heartbeats"].split(",")[0]) >= 45  # the first has no key yet
    assert lines["1"].startswith("stopped the drives: the node's heartbeats stopped; ")


def test_a_second_guard_of_a_bus_is_refused(processes: Processes) -> None:
    first = processes.start("guard")
    assert first.stderr is not None
    while "guard on" not in first.stderr.readline():
        pass
    second = processes.start("guard")
    _, errors = second.communicate(timeout=PATIENCE_S)

    assert second.returncode == 4
    assert "a guard of this bus already runs" in errors


def test_a_second_run_on_a_bus_is_refused_and_the_first_drives_on(processes: Processes) -> None:
    processes.start("plant")
    first = processes.start("run", "--no-ros", "--no-log", "--json")
    processes.wait_for(lambda m: is_state(m, BoardState.ENABLED))
    second = processes.start("run", "--no-ros", "--no-log")
    _, errors = second.communicate(timeout=PATIENCE_S)
    report, _ = ended(first)

    assert second.returncode == 4
    assert f"is controlled by process {first.pid} (" in errors
    mode = next(values for name, values in report["diagnostics"].items() if name.endswith(": mode"))
    assert mode["mode"] == "ARMED"
    hardware = next(values for name, values in report["diagnostics"].items() if name.endswith(": hardware"))
    assert hardware["strange_commands"] == "0"


def test_of_two_that_start_together_one_runs(processes: Processes) -> None:
    processes.start("plant")
    both = [processes.start("run", "--no-ros", "--no-log", "--json", "--duration", "3") for _ in range(2)]
    outcomes = []
    for each in both:
        out, errors = each.communicate(timeout=PATIENCE_S)
        outcomes.append((each.returncode, "is controlled by process" in errors, bool(out)))

    assert sorted(outcomes) == [(0, False, True), (4, True, False)]


def test_a_recording_that_is_played_beside_the_node_is_a_fault_that_names_it(processes: Processes) -> None:
    processes.start("plant")
    node = processes.start("run", "--no-ros", "--no-log", "--json")
    recorded = processes.wait_for(lambda m: is_command(m, enable=True))
    processes.wait_for(lambda m: is_state(m, BoardState.ENABLED))
    processes.heard_within(0.5)
    processes.bus.send(recorded)
    processes.wait_for(lambda m: is_state(m, BoardState.DISABLED))
    report, _ = ended(node)

    mode = next(values for name, values in report["diagnostics"].items() if name.endswith(": mode"))
    assert mode["mode"] == "FAULT"
    assert mode["reason"].startswith("command frames that this node did not send, 0x114 (1): ")


def test_a_robot_that_needs_a_guard_arms_with_one_and_reports_its_end(processes: Processes, tmp_path: Path) -> None:
    text = (Path(config.__file__).parent / "robots" / "cart-can.yaml").read_text("utf-8")
    needs = tmp_path / "needs.yaml"
    needs.write_text(text.replace("  watchdog_s: 0.04\n", "  watchdog_s: 0.04\n  guard: required\n"), "utf-8")
    processes.start("plant", robot=str(needs))
    node = processes.start("run", "--no-ros", "--no-log", "--json", robot=str(needs))
    processes.wait_for(lambda m: m.arbitration_id == CommandId.RIGHT_COMMAND)
    assert not [m for m in processes.heard_within(2.0) if is_command(m, enable=True)]
    guard = processes.start("guard", "--limit", "0.2", robot=str(needs))
    processes.wait_for(lambda m: is_state(m, BoardState.ENABLED))
    guard.kill()
    assert node.stderr is not None
    while "the guard of this bus has ended" not in node.stderr.readline():
        pass
    report, _ = ended(node)

    mode = next(values for name, values in report["diagnostics"].items() if name.endswith(": mode"))
    assert mode["mode"] == "ARMED"
    assert mode["check.drives"].startswith("refused: no guard watches this bus")
