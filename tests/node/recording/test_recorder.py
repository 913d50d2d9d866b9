# SPDX-License-Identifier: MIT
"""The recorder's process: what the loop sees of it while it works, stalls, or is gone."""

import json
import logging
import os
import resource
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from msgspec.structs import replace

from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node import helper
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord, Inbox, NoStage, Report, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording import cdr
from segway_ecc.node.recording.cycle_log import EVENTS_TOPIC
from segway_ecc.node.recording.layout import END_FILE, CycleLayout, LogEnd, Provenance, layout_of
from segway_ecc.node.recording.recorder import ProcessRecorder
from segway_ecc.node.recording.salvage import Salvage
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Mode
from tests.patience import PATIENCE_S

MORE_THAN_FIT = 5000


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


@pytest.fixture
def recorder(path: Path, layout: CycleLayout) -> Iterator[ProcessRecorder]:
    made = ProcessRecorder(path, layout, Provenance({"robot.yaml": "name: testbot"}, {}))
    yield made
    if made._process.poll() is None:
        made._process.kill()
    made._process.wait()
    assert made._process.stdin is not None
    made._process.stdin.close()


def logged(path: Path) -> list[float]:
    """The linear set-points in a log, which are 0.5 and the number of their cycle."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [message.twist.linear.x for *_, message in reader.iter_decoded_messages(["/setpoint"])]


def salvaged(path: Path) -> list[int]:
    """The cycles in a log that is still being written."""
    messages = [message.data for topic, message in Salvage(path).messages() if topic == "/cycle"]
    return [struct.unpack_from("<Q", data, 20)[0] for data in messages]


def wait_for(condition: Callable[[], bool]) -> None:
    """Other processes take as long as they take."""
    give_up_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up_s
        time.sleep(0.02)


def test_a_log_that_is_a_pipe_is_refused(path: Path, layout: CycleLayout) -> None:
    os.mkfifo(path)
    with pytest.raises(RecordingError, match=r"^cannot write the log .*: it is no file; choose another with --log$"):
        ProcessRecorder(path, layout, Provenance({}, {}))


def test_a_writer_that_does_not_start_is_an_error_of_the_log(
    path: Path, layout: CycleLayout, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    start = helper.start_helper

    def started(*words: Any) -> Any:
        process = start(*words)
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        return process

    monkeypatch.setattr("segway_ecc.node.recording.recorder.start_helper", started)
    with pytest.raises(RecordingError, match="the process that writes it ended as it started, with status 1"):
        ProcessRecorder(path, layout, Provenance({}, {}))


def test_every_cycle_arrives_in_order(
    recorder: ProcessRecorder, path: Path, record: Callable[[int], CycleRecord]
) -> None:
    for cycle in range(300):
        recorder.write(record(cycle))
    recorder.close()

    assert recorder.dropped == 0
    assert logged(path) == [0.5 + cycle for cycle in range(300)]


def test_diagnostics_and_the_robot_file_arrive(recorder: ProcessRecorder, path: Path) -> None:
    statuses = [
        DiagnosticStatus(Level.OK, "one", "fine", {}),
        DiagnosticStatus(Level.ERROR, "two", "bad", {"why": "broken"}),
    ]
    recorder.write_diagnostics(5, statuses)
    recorder.close()
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [message for *_, message in reader.iter_decoded_messages(["/diagnostics"])]
        attachments = {found.name: found.data for found in reader.iter_attachments()}

    assert [status.name for message in messages for status in message.status] == ["one", "two"]
    assert attachments["robot.yaml"] == b"name: testbot"


def test_closing_a_sound_recorder_warns_of_nothing(
    recorder: ProcessRecorder, record: Callable[[int], CycleRecord], caplog: pytest.LogCaptureFixture
) -> None:
    recorder.write(record(0))
    recorder.close()

    assert caplog.records == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGABRT])
def test_what_ends_the_loop_leaves_the_writer_to_finish_the_log(
    recorder: ProcessRecorder,
    path: Path,
    record: Callable[[int], CycleRecord],
    number: int,
    caplog: pytest.LogCaptureFixture,
) -> None:
    recorder.write(record(0))
    wait_for(lambda: bool(salvaged(path)))
    recorder._process.send_signal(number)
    recorder.write(record(1))
    recorder.close()

    assert recorder._process.returncode == 0
    assert caplog.records == []


def test_a_killed_writer_costs_only_its_cycles(
    recorder: ProcessRecorder,
    path: Path,
    record: Callable[[int], CycleRecord],
    caplog: pytest.LogCaptureFixture,
) -> None:
    recorder._process.send_signal(signal.SIGKILL)
    recorder._process.wait(PATIENCE_S)
    for cycle in range(11):
        recorder.write(record(cycle))
    with pytest.raises(RecordingError, match=f"the process that writes the log {path} is gone"):
        recorder.write_diagnostics(5, [DiagnosticStatus(Level.OK, "one", "fine", {})])
    recorder.close()

    assert recorder.dropped == 11
    assert [entry.getMessage() for entry in caplog.records] == [
        f"the recorder ended with status -9; the log {path} may be incomplete",
        f"at least 11 records are missing in the log {path}: cycles 0 to 10, and what came with them",
    ]
    assert {entry.levelno for entry in caplog.records} == {logging.WARNING}


def test_a_loop_whose_writer_is_killed_drives_on_and_reports_it_once(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    recorder = ProcessRecorder(path, layout_of(robot))

    class KillsIt(NoStage):
        cycles = 0

        def publish(self, report: Report) -> None:
            del report
            self.cycles += 1
            if self.cycles == 150:
                wait_for(lambda: bool(salvaged(path)))
                recorder._process.kill()
                recorder._process.wait(PATIENCE_S)

    loop = robot.loop(KillsIt(), recorder)
    with caplog.at_level(logging.WARNING):
        loop.run(450)
    lines = [entry.getMessage() for entry in caplog.records]
    kept = salvaged(path)

    assert loop.counters.cycles == 450
    assert loop.modes.mode is Mode.ARMED
    assert lines.count(f"recording has ended: RecordingError: the process that writes the log {path} is gone") == 1
    first, last = len(kept), len(kept) + recorder.dropped - 1
    lost = f"at least {recorder.dropped} records are missing in the log {path}: cycles {first} to "
    (said,) = [line for line in lines if line.startswith(lost)]
    handed_over = int(said.removeprefix(lost).split(",")[0]) + 1
    assert handed_over <= last + 1
    # What was handed over, and what was not: every cycle of the run is in the log or counted.
    assert f"the log lacks {450 - handed_over} cycles, from cycle {handed_over} on: none was handed over" in lines
    assert kept == list(range(len(kept)))
    # It is asked for once a second, and given nothing from then on.
    assert 50 <= recorder.dropped <= 160


def test_what_a_killed_writer_had_taken_and_not_written_is_counted(
    recorder: ProcessRecorder, path: Path, record: Callable[[int], CycleRecord], caplog: pytest.LogCaptureFixture
) -> None:
    for cycle in range(10):
        recorder.write(record(cycle))
    wait_for(lambda: len(salvaged(path)) == 10)
    recorder._process.kill()
    recorder._process.wait(PATIENCE_S)
    for cycle in range(10, 40):
        recorder.write(record(cycle))
    while recorder._ring.held():  # as if the writer had taken them and died before its next flush
        recorder._ring._ring[: recorder._ring._slots] = bytes(recorder._ring._slots)
    recorder.close()

    assert recorder.dropped == 30
    assert caplog.messages[-1] == (
        f"at least 30 records are missing in the log {path}: cycles 10 to 39, and what came with them"
    )


def test_the_last_cycle_of_a_run_is_named_where_it_found_no_room(
    recorder: ProcessRecorder, path: Path, record: Callable[[int], CycleRecord]
) -> None:
    recorder._process.send_signal(signal.SIGSTOP)
    os.waitpid(recorder._process.pid, os.WUNTRACED)
    for cycle in range(MORE_THAN_FIT):
        recorder.write(record(cycle))
    recorder._process.send_signal(signal.SIGCONT)
    recorder.close()

    end = msgspec.json.decode(Salvage(path).attachments[END_FILE], type=LogEnd)
    assert (end.number, end.last_cycle) == (1, MORE_THAN_FIT - 1)


def test_a_stopped_writer_holds_nothing_up_and_what_does_not_fit_is_counted(
    recorder: ProcessRecorder, path: Path, record: Callable[[int], CycleRecord]
) -> None:
    recorder._process.send_signal(signal.SIGSTOP)
    os.waitpid(recorder._process.pid, os.WUNTRACED)
    for cycle in range(MORE_THAN_FIT):
        recorder.write(record(cycle))
    dropped = recorder.dropped
    recorder._process.send_signal(signal.SIGCONT)
    recorder.close()

    assert 0 < dropped <= MORE_THAN_FIT - 1024
    # What was taken was taken whole, and in order.
    assert logged(path) == [0.5 + cycle for cycle in range(MORE_THAN_FIT - dropped)]
    # No number of a later cycle shows that these are missing.
    assert Salvage(path).damage == [f"{path.name}: {dropped} messages never reached it"]


def test_a_cycle_with_many_events_arrives_whole(
    recorder: ProcessRecorder, path: Path, record: Callable[[int], CycleRecord]
) -> None:
    inbox = Inbox(setpoints=[StampedSetpoint(Setpoint(1.0, 2.0), stamp) for stamp in range(500)])
    recorder.write(replace(record(0), inbox=inbox))
    recorder.write(record(1))
    recorder.close()
    messages = [(topic, message.data) for topic, message in Salvage(path).messages()]
    events = [texts for topic, data in messages if topic == EVENTS_TOPIC for texts in cdr.read_cycle_events(data)[1]]

    assert recorder.dropped == 0
    assert salvaged(path) == [0, 1]
    assert len(events) == 500


def test_a_damaged_record_is_skipped_and_reported(
    path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord], capfd: pytest.CaptureFixture[str]
) -> None:
    recorder = ProcessRecorder(path, layout)
    recorder.write(record(0))
    recorder._ring.put(ord("C"), b"no cycle.")
    recorder.write(record(2))
    recorder.close()

    assert salvaged(path) == [0, 2]
    assert f"1 records were damaged on their way and are missing in the log {path}" in capfd.readouterr().err


def test_a_writer_that_never_ends_is_ended(
    recorder: ProcessRecorder, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("segway_ecc.node.recording.recorder._CLOSE_S", 0.01)
    recorder._process.send_signal(signal.SIGSTOP)
    recorder.close()

    assert recorder._process.returncode == -signal.SIGKILL
    assert "the recorder ended with status -9" in caplog.text


def test_a_message_that_would_not_fit_whole_is_dropped(recorder: ProcessRecorder, path: Path) -> None:
    recorder.write_diagnostics(
        5, [DiagnosticStatus(Level.OK, "one", "x" * 70_000, {}), DiagnosticStatus(Level.OK, "two", "fine", {})]
    )
    recorder.close()
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [message for *_, message in reader.iter_decoded_messages(["/diagnostics"])]

    assert recorder.dropped == 1
    assert [status.name for message in messages for status in message.status] == ["two"]


def test_a_path_that_cannot_be_written_is_reported_before_anything_starts(tmp_path: Path, layout: CycleLayout) -> None:
    (tmp_path / "file").touch()
    for bad in (tmp_path, tmp_path / "file" / "run.mcap"):
        with pytest.raises(RecordingError, match=r"cannot write the log .*; choose another with --log"):
            ProcessRecorder(bad, layout)


def test_a_disk_that_is_full_holds_nothing_up_and_the_log_goes_on_when_there_is_room(
    path: Path,
    layout: CycleLayout,
    record: Callable[[int], CycleRecord],
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    recorder = ProcessRecorder(path, layout)  # here, so that the writer's output is captured
    wait_for(lambda: path.stat().st_size > 1000)  # it has begun the first file
    # The kernel refuses to let the writer's files grow beyond this; it sends SIGXFSZ, which Python ignores.
    _, hard = resource.prlimit(recorder._process.pid, resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))
    for cycle in range(300):
        recorder.write(record(cycle))
    lines: list[str] = []

    def has_failed() -> bool:
        lines.append(capfd.readouterr().err)
        return "failed" in "".join(lines)

    wait_for(has_failed)
    resource.prlimit(recorder._process.pid, resource.RLIMIT_FSIZE, (hard, hard))
    second = path.with_name("run-0002.mcap")
    cycle = 300
    while not (second.exists() and second.stat().st_size > 5000):  # the writer tries again by itself
        recorder.write(record(cycle))
        cycle += 1
        time.sleep(0.01)
    recorder.close()
    found = logged(second)

    assert recorder.dropped == 0
    assert caplog.records == []
    assert found == [0.5 + number for number in range(cycle - len(found), cycle)]
    assert f"recorder: the log goes on in {second}; " in "".join([*lines, capfd.readouterr().err])


def test_a_disk_that_stays_full_is_reported_once(
    path: Path,
    layout: CycleLayout,
    record: Callable[[int], CycleRecord],
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    recorder = ProcessRecorder(path, layout)
    resource.prlimit(recorder._process.pid, resource.RLIMIT_FSIZE, (1000, 1000))
    for cycle in range(300):
        recorder.write(record(cycle))
    recorder.close()

    assert f"the recorder ended with status 9; the log {path} may be incomplete" in caplog.text
    first, last = capfd.readouterr().err.splitlines()
    assert first.startswith(f"segway-ecc: recorder: Writing the log {path} failed ")
    assert last == f"segway-ecc: recorder: 300 messages at the end of the log {path} are missing"


def test_what_was_handed_over_is_on_the_disk_soon_without_closing(
    recorder: ProcessRecorder, path: Path, record: Callable[[int], CycleRecord]
) -> None:
    for cycle in range(10):
        recorder.write(record(cycle))
    wait_for(lambda: len(salvaged(path)) == 10)

    assert salvaged(path) == list(range(10))


def test_a_robot_with_many_ports_is_recorded(
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]
) -> None:
    names = tuple(f"port{n}" for n in range(2000))
    recorder = ProcessRecorder(tmp_path / "run.mcap", msgspec.structs.replace(layout, inputs=names))
    for cycle in range(3):
        recorder.write(replace(record(cycle), u=[0.1] * len(names)))
    recorder.close()

    assert recorder.dropped == 0
    assert salvaged(tmp_path / "run.mcap") == [0, 1, 2]


@pytest.mark.parametrize(
    ("period_ns", "cycles"), [(10_000_000, 500), (5_000_000, 1000), (1_000_000, 1024), (200_000_000, 256)]
)
def test_the_ring_holds_what_comes_while_a_disk_is_busy_for_5_s(
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord], period_ns: int, cycles: int
) -> None:
    recorder = ProcessRecorder(tmp_path / "run.mcap", msgspec.structs.replace(layout, period_ns=period_ns))
    recorder._process.send_signal(signal.SIGSTOP)
    os.waitpid(recorder._process.pid, os.WUNTRACED)
    for cycle in range(cycles):
        recorder.write(record(cycle))
        if cycle % 100 == 0:
            recorder.write_diagnostics(
                cycle, [DiagnosticStatus(Level.OK, f"part {n}", "x" * 200, {}) for n in range(20)]
            )
    dropped = recorder.dropped
    recorder._process.send_signal(signal.SIGCONT)
    recorder.close()

    assert dropped == 0


def test_a_robot_whose_cycle_is_too_large_is_refused(tmp_path: Path, layout: CycleLayout) -> None:
    large = msgspec.structs.replace(layout, inputs=tuple(f"port{n}" for n in range(8000)))
    with pytest.raises(RecordingError, match=r"a cycle of robot 'testbot' takes 7\d{4} bytes"):
        ProcessRecorder(tmp_path / "run.mcap", large)


NODE = """
import os, signal, sys, time
from pathlib import Path
import msgspec
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.recording.layout import CycleLayout
from segway_ecc.node.recording.recorder import ProcessRecorder
from segway_ecc.node.safety.modes import Mode

layout = msgspec.json.decode(sys.argv[2], type=CycleLayout)
recorder = ProcessRecorder(Path(sys.argv[1]), layout)
count = len(layout.sensors)
sensors = Sensors((1.0,) * count, (1.0,) * count, (True,) * count)
def write(cycle):
    numbers = [(0.0,) * len(names) for names in (layout.inputs, layout.outputs, layout.commands, layout.published)]
    recorder.write(CycleRecord(cycle, cycle, Mode.ARMED, 0, sensors, Setpoint(0.5 + cycle, 0.0), *numbers, (0,) * 5))
for cycle in range(50):
    write(cycle)
while Path(sys.argv[1]).stat().st_size < 500:  # what begins the log is not on the disk yet
    time.sleep(0.01)
if sys.argv[3] == "stopped":
    os.kill(recorder._process.pid, signal.SIGSTOP)
print(recorder._process.pid, flush=True)
for cycle in range(50, 100):
    write(cycle)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("state", ["running", "stopped"])
def test_the_writer_of_a_killed_node_finishes_the_log_and_ends(path: Path, layout: CycleLayout, state: str) -> None:
    command = [sys.executable, "-c", NODE, str(path), msgspec.json.encode(layout).decode(), state]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as node:
        assert node.stdout is not None
        writer = Path(f"/proc/{int(node.stdout.readline())}")
        node.wait(PATIENCE_S)
        wait_for(lambda: not writer.exists() or (writer / "stat").read_text().split()[2] == "Z")

    assert node.returncode == -signal.SIGKILL
    assert logged(path) == [0.5 + cycle for cycle in range(100)]
    assert END_FILE not in Salvage(path).attachments


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_the_whole_process_group_leaves_a_finished_log(path: Path, number: signal.Signals) -> None:
    words = ["run", "cart", "--no-ros", "--log", str(path), "--json"]
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as node:
        assert node.stderr is not None
        while "ARMED" not in (line := node.stderr.readline()):
            assert line, "the node ended before it was armed"
        os.killpg(node.pid, number)
        out, errors = node.communicate(timeout=PATIENCE_S)

    assert node.returncode == 0
    assert errors.splitlines() == [f"segway-ecc: stopped: {number.name}"]
    assert len(logged(path)) == json.loads(out)["cycles"]
    assert END_FILE in Salvage(path).attachments


def test_a_log_is_not_begun_where_later_files_of_another_are(path: Path, layout: CycleLayout) -> None:
    path.write_bytes(b"the first file")
    path.with_name("run-0002.mcap").write_bytes(b"the second")

    with pytest.raises(RecordingError, match=r"cannot write the log .*run\.mcap: run-0002\.mcap, .* is there"):
        ProcessRecorder(path, layout)
    assert path.read_bytes() == b"the first file"
