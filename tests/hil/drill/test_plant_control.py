# SPDX-License-Identifier: MIT
"""Faults that are asked for line by line, and the link that loses frames."""

import itertools
import json
import os
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from segway_ecc.firmware_io.drives.wheel_board.frames import WheelCommand
from segway_ecc.firmware_io.drives.wheel_board.session import CommandSession
from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.local_bus import LocalBus
from segway_ecc.hil.drill.plant_control import DisturbedLink, DisturbedPort, LineReader, PlantControl
from segway_ecc.hil.rig.no_bus import NoBus
from segway_ecc.hil.rig.simulated_bus import SimulatedLink
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial
from segway_ecc.hil.rig.simulation import LockstepRig, simulated_robot
from segway_ecc.node.config import load_robot
from segway_ecc.testing import START_NS, ScriptedClock
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.real_time

TICK_NS = 5_000_000
LEFT_WHEEL, RIGHT_WHEEL = 0x120, 0x121


class Bench(NamedTuple):
    """A plant on a simulated bus, with our end of it."""

    control: PlantControl
    link: DisturbedLink
    robot: SimulatedRobot
    host: SimulatedLink
    rig: LockstepRig

    def tick(self) -> list[Frame]:
        """One tick; what is heard of it a millisecond later."""
        self.robot.tick(self.rig.now_ns())
        self.rig.sleep_until_ns(self.rig.now_ns() + TICK_NS)
        return self.host.receive()

    def ask(self, line: str) -> str:
        stamp, _, answer = self.control.obey(line).partition(" ")
        assert int(stamp) == START_NS
        return answer


@pytest.fixture
def bench() -> Bench:
    rig = LockstepRig(500_000)
    link = DisturbedLink(rig.bus.attach("plant"))
    robot = simulated_robot(load_robot("cart-can"), link)
    return Bench(PlantControl(robot, link, robot.plant, ScriptedClock()), link, robot, rig.bus.attach("host"), rig)


def body(frames: list[Frame], arbitration_id: int) -> bytes:
    """What a wheel measures, without counter and CRC."""
    (found,) = [frame.data[:6] for frame in frames if frame.arbitration_id == arbitration_id]
    return found


def test_a_mute_drive_receives_and_its_frames_are_lost(bench: Bench) -> None:
    assert bench.ask("mute") == "mute"
    assert bench.link.send(Frame(1, b""))
    bench.host.send(Frame(2, b"x"))
    assert bench.tick() == []
    bench.link.receive()
    bench.host.send(Frame(3, b"x"))
    bench.rig.sleep_until_ns(bench.rig.now_ns() + TICK_NS)
    assert [frame.arbitration_id for frame in bench.link.receive()] == [3]
    assert bench.ask("heal") == "heal"
    assert bench.tick()


def test_over_a_cut_cable_nothing_passes(bench: Bench) -> None:
    assert bench.ask("cut") == "cut"
    bench.host.send(Frame(2, b"x"))
    bench.rig.sleep_until_ns(bench.rig.now_ns() + TICK_NS)
    assert bench.link.receive() == []
    assert bench.tick() == []
    bench.ask("heal")
    assert bench.link.receive() == [], "what was lost stays lost"
    assert bench.tick()


def test_a_lost_bus_raises_unless_the_cable_is_cut(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(_link: object) -> list[Frame]:
        raise LinkLostError("gone")

    monkeypatch.setattr(SimulatedLink, "receive", lost)
    with pytest.raises(LinkLostError):
        bench.link.receive()
    bench.link.disturbance = "cut"
    assert bench.link.receive() == []


def test_the_link_reports_the_state_of_the_one_behind(bench: Bench) -> None:
    behind = bench.rig.bus.attach("other")
    link = DisturbedLink(behind)
    assert (link.description, link.state, link.health) == (behind.description, behind.state, behind.health)
    assert link.counters is behind.counters


def test_a_frozen_sensor_repeats_itself_with_good_counters_and_the_rest_goes_on(bench: Bench) -> None:
    session = CommandSession()
    session.begin(1)
    for is_on in (False, True):
        for frame in session.command(WheelCommand(6.0, 6.0, enable=is_on)):
            bench.host.send(frame)
        bench.rig.sleep_until_ns(bench.rig.now_ns() + TICK_NS)
    bench.tick()
    first = bench.tick()
    assert bench.ask("freeze left") == "freeze left"
    later = [bench.tick() for _ in range(4)]

    frozen = {body(frames, LEFT_WHEEL) for frames in later}
    assert len(frozen) == 1
    assert struct.unpack("<ih", frozen.pop())[1] > 0
    assert len({body(frames, RIGHT_WHEEL) for frames in later}) == 4
    counters = [frames[0].data[6] & 0x0F for frames in [first, *later]]
    assert [(b - a) % 16 for a, b in itertools.pairwise(counters)] == [1] * 4
    assert bench.robot.outputs[bench.robot.output_names.index("left.angle")] > 0
    bench.ask("heal")
    healed = {body(bench.tick(), LEFT_WHEEL) for _ in range(3)}
    assert len(healed) == 3


def test_a_sensor_measures_too_much_until_it_is_healed(bench: Bench) -> None:
    bench.tick()
    true = struct.unpack("<ih", body(bench.tick(), LEFT_WHEEL))
    assert bench.ask("add left.velocity 1.5") == "add left.velocity 1.5"
    wrong = struct.unpack("<ih", body(bench.tick(), LEFT_WHEEL))
    assert wrong[0] == true[0]
    assert wrong[1] > true[1]
    bench.ask("heal")
    assert struct.unpack("<ih", body(bench.tick(), LEFT_WHEEL)) == true
    assert bench.ask("add left much") == "refused: 'much' is not a number"
    assert bench.ask("add nothing 1").startswith("refused: nothing measured begins with 'nothing'; there is ")
    assert bench.robot.errors == {}


def test_one_signal_can_be_frozen(bench: Bench) -> None:
    bench.ask("freeze left.velocity")
    assert list(bench.robot.stuck) == ["left.velocity"]


@pytest.mark.parametrize("what", ["lef", "truth", "truth.x", "left.", ""])
def test_what_is_not_measured_cannot_be_frozen(bench: Bench, what: str) -> None:
    assert bench.ask(f"freeze {what}").startswith("refused: ")
    assert not bench.robot.stuck


def test_the_plant_is_written_to(bench: Bench) -> None:
    assert bench.ask("write Friction 0.25") == "write Friction 0.25"
    assert bench.robot.plant.read("Friction") == 0.25


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("write Friction fast", "'fast' is not a number"),
        ("write Friction nan", "Friction"),
        ("write Nothing 1", "Nothing"),
        ("write Friction", "it must be mute, cut, "),
        ("mute now", "it must be mute, cut, "),
        ("", "it must be mute, cut, "),
        ("explode", "it must be mute, cut, "),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_reason(bench: Bench, line: str, why: str) -> None:
    answer = bench.ask(line)
    assert answer.startswith("refused: ")
    assert why in answer
    assert bench.link.disturbance is None


class Pipes(NamedTuple):
    """A reader of lines between two pipes."""

    reader: LineReader
    write: int
    answers: int
    ends: list[int]
    obeyed: list[str]

    def said(self) -> bytes:
        try:
            return os.read(self.answers, 1 << 20)
        except BlockingIOError:
            return b""


@pytest.fixture
def pipes() -> Iterator[Pipes]:
    source, write = os.pipe()
    answers, sink = os.pipe()
    os.set_blocking(answers, False)
    ends: list[int] = []
    obeyed: list[str] = []

    def obey(line: str) -> str:
        obeyed.append(line)
        return f"did {line}"

    yield Pipes(LineReader(source, sink, obey, lambda: ends.append(1)), write, answers, ends, obeyed)
    for descriptor in (source, answers, sink):
        os.close(descriptor)


def test_lines_may_come_in_pieces_and_many_at_once(pipes: Pipes) -> None:
    pipes.reader()
    for piece in (b"mu", b"te\ncut\nhe", b"al", b"\n"):
        os.write(pipes.write, piece)
        pipes.reader()
    assert pipes.said() == b"did mute\ndid cut\ndid heal\n"
    os.close(pipes.write)


def test_a_line_that_is_too_long_or_no_text_is_no_line(pipes: Pipes) -> None:
    os.write(pipes.write, b"x" * 200 + b"\n" + b"x" * 201 + b"\n" + b"\xff\n")
    pipes.reader()
    for _ in range(100):
        os.write(pipes.write, b"y" * 4096)
        pipes.reader()
    os.write(pipes.write, b"\nheal\n")
    pipes.reader()
    assert pipes.obeyed == ["x" * 200, "?", "?", "?", "heal"]
    os.close(pipes.write)


def test_answers_that_nobody_reads_hold_up_nobody(pipes: Pipes) -> None:
    for _ in range(2000):
        os.write(pipes.write, b"z" * 100 + b"\n")
        pipes.reader()
    assert len(pipes.obeyed) == 2000
    os.close(pipes.write)


def test_the_end_is_reported_once(pipes: Pipes) -> None:
    os.close(pipes.write)
    for _ in range(3):
        pipes.reader()
    assert pipes.ends == [1]


def test_the_descriptors_are_left_as_they_were(pipes: Pipes) -> None:
    source = pipes.reader._source
    assert not os.get_blocking(source)
    pipes.reader.close()
    assert os.get_blocking(source)
    os.close(pipes.write)


def test_the_plant_obeys_traces_and_ends_with_whoever_controls_it(tmp_path: Path) -> None:
    channel, trace = f"control_{os.getpid()}", tmp_path / "trace.csv"
    words = ["plant", "cart-can", "--interface", "local", "--channel", channel, "--control", "--trace", str(trace)]
    pipe: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with (
        LocalBus(channel) as bus,
        subprocess.Popen(
            [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words, "--json"], text=True, **pipe
        ) as plant,
    ):
        assert plant.stdin is not None
        assert plant.stdout is not None
        assert bus.recv(PATIENCE_S) is not None
        before_ns = time.monotonic_ns()
        plant.stdin.write("mute\n")
        plant.stdin.flush()
        stamp, word = plant.stdout.readline().split()
        while bus.recv(0.1) is not None:
            pass  # what was sent before
        out, errors = plant.communicate(timeout=PATIENCE_S)

    assert word == "mute"
    assert before_ns < int(stamp) < time.monotonic_ns()
    assert plant.returncode == 0, errors
    head, *rows = [line.split(",") for line in trace.read_text().splitlines()]
    assert head == ["monotonic_ns", "wall_ns", "left.voltage", "right.voltage"]
    assert len(rows) == json.loads(out)["ticks"]
    assert {value for row in rows for value in row[2:]} == {"0.0"}
    assert int(rows[0][0]) < int(stamp) < int(rows[-1][0])


def test_a_serial_line_in_place_of_a_bus_is_disturbed_as_that_is() -> None:
    now_ns = 0
    wires, link = SimulatedSerial(115_200, lambda: now_ns), DisturbedLink(NoBus())
    port = DisturbedPort(wires.device, link)

    def pass_both_ways() -> tuple[bytes, bytes]:
        nonlocal now_ns
        wires.host.write(b"forth")
        assert port.write(b"back") == 4
        now_ns += 10_000_000
        return port.read(port.in_waiting), wires.host.read(100)

    assert pass_both_ways() == (b"forth", b"back")
    link.disturbance = "mute"
    assert pass_both_ways() == (b"forth", b"")
    link.disturbance = "cut"
    assert pass_both_ways() == (b"", b"")
    link.disturbance = None
    assert pass_both_ways() == (b"forth", b"back")
    port.close()
