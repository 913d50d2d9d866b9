"""The recorder's process: what the loop sees of it while it works, stalls, or is gone."""

import json
import logging
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from node.cycle.seams import CycleRecord
from node.cycle.status import Level, Status
from node.errors import RecordingError
from node.recording.codec import CycleCodec
from node.recording.cycle_log import Layout
from node.recording.recorder import ProcessRecorder

MORE_THAN_A_PIPE_HOLDS = 10_000
ENDS_WITHIN_S = 30.0


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


@pytest.fixture
def recorder(path: Path, layout: Layout) -> Iterator[ProcessRecorder]:
    made = ProcessRecorder(path, layout, {"robot.yaml": "name: testbot"})
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


def test_every_cycle_arrives_in_order(
    recorder: ProcessRecorder, path: Path, record: Callable[[int], CycleRecord]
) -> None:
    for cycle in range(300):
        recorder.write(record(cycle))
    recorder.close()

    assert recorder.dropped == 0
    assert logged(path) == [0.5 + cycle for cycle in range(300)]


def test_diagnostics_and_the_robot_file_arrive(recorder: ProcessRecorder, path: Path) -> None:
    statuses = [Status(Level.OK, "one", "fine", {}), Status(Level.ERROR, "two", "bad", {"why": "broken"})]
    recorder.write_diagnostics(5, statuses)
    recorder.close()
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [message for *_, message in reader.iter_decoded_messages(["/diagnostics"])]
        (attachment,) = reader.iter_attachments()

    assert [status.name for message in messages for status in message.status] == ["one", "two"]
    assert (attachment.name, attachment.data) == ("robot.yaml", b"name: testbot")


def test_closing_a_sound_recorder_warns_of_nothing(
    recorder: ProcessRecorder, record: Callable[[int], CycleRecord], caplog: pytest.LogCaptureFixture
) -> None:
    recorder.write(record(0))
    recorder.close()

    assert caplog.records == []


def test_a_killed_writer_costs_only_its_cycles(
    recorder: ProcessRecorder,
    path: Path,
    record: Callable[[int], CycleRecord],
    caplog: pytest.LogCaptureFixture,
) -> None:
    recorder.write(record(0))
    recorder._process.send_signal(signal.SIGKILL)
    recorder._process.wait(ENDS_WITHIN_S)
    for cycle in range(1, 11):
        recorder.write(record(cycle))
    recorder.write_diagnostics(5, [Status(Level.OK, "one", "fine", {})])
    recorder.close()

    assert recorder.dropped == 11
    assert [entry.getMessage() for entry in caplog.records] == [
        f"the recorder ended with status -9; the log {path} may be incomplete",
        f"11 records are missing in the log {path}",
    ]
    assert {entry.levelno for entry in caplog.records} == {logging.WARNING}


def test_a_stopped_writer_holds_nothing_up_and_what_does_not_fit_is_counted(
    recorder: ProcessRecorder, path: Path, layout: Layout, record: Callable[[int], CycleRecord]
) -> None:
    recorder._process.send_signal(signal.SIGSTOP)
    os.waitpid(recorder._process.pid, os.WUNTRACED)
    # More bytes than the pipe takes: a write that waited would wait for ever.
    for cycle in range(MORE_THAN_A_PIPE_HOLDS):
        recorder.write(record(cycle))
    dropped = recorder.dropped
    recorder._process.send_signal(signal.SIGCONT)
    recorder.close()

    assert len(CycleCodec(layout).pack(record(0))) * MORE_THAN_A_PIPE_HOLDS > 2 << 20
    assert dropped > MORE_THAN_A_PIPE_HOLDS // 2
    # What was taken was taken whole, and in order.
    assert logged(path) == [0.5 + cycle for cycle in range(MORE_THAN_A_PIPE_HOLDS - dropped)]


def test_a_writer_that_never_ends_is_ended(
    recorder: ProcessRecorder, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("node.recording.recorder._CLOSE_S", 0.01)
    recorder._process.send_signal(signal.SIGSTOP)
    recorder.close()

    assert recorder._process.returncode == -signal.SIGKILL
    assert "the recorder ended with status -9" in caplog.text


def test_a_frame_that_would_not_fit_whole_is_dropped(recorder: ProcessRecorder, path: Path) -> None:
    recorder.write_diagnostics(5, [Status(Level.OK, "one", "x" * 5000, {}), Status(Level.OK, "two", "fine", {})])
    recorder.close()
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [message for *_, message in reader.iter_decoded_messages(["/diagnostics"])]

    assert recorder.dropped == 1
    assert [status.name for message in messages for status in message.status] == ["two"]


def test_a_path_that_cannot_be_written_is_told_before_anything_starts(tmp_path: Path, layout: Layout) -> None:
    (tmp_path / "file").touch()
    for bad in (tmp_path, tmp_path / "file" / "run.mcap"):
        with pytest.raises(RecordingError, match=r"cannot write the log .*; choose another with --log"):
            ProcessRecorder(bad, layout, {})


def test_a_disk_that_is_full_from_the_start_does_not_end_the_loop(
    layout: Layout,
    record: Callable[[int], CycleRecord],
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    recorder = ProcessRecorder(Path("/dev/full"), layout, {})
    recorder._process.wait(ENDS_WITHIN_S)
    recorder.write(record(0))
    recorder.close()

    assert recorder.dropped == 1
    assert "the recorder ended with status 9; the log /dev/full may be incomplete" in caplog.text
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("segway-ecc: recorder: Writing the log /dev/full failed ")


def test_a_disk_that_is_full_in_the_middle_does_not_end_the_loop(
    recorder: ProcessRecorder, record: Callable[[int], CycleRecord], caplog: pytest.LogCaptureFixture
) -> None:
    # The kernel refuses to let the writer's files grow beyond this; it sends SIGXFSZ, which Python ignores.
    resource.prlimit(recorder._process.pid, resource.RLIMIT_FSIZE, (1000, 1000))
    for cycle in range(300):
        recorder.write(record(cycle))
    recorder.close()

    assert "the recorder ended with status 9" in caplog.text


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_the_whole_process_group_leaves_a_finished_log(path: Path, number: signal.Signals) -> None:
    words = ["run", "cart", "--no-ros", "--log", str(path), "--json"]
    with subprocess.Popen(
        [sys.executable, "-m", "node.cli.main", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as node:
        assert node.stderr is not None
        while "ARMED" not in (line := node.stderr.readline()):
            assert line, "the node ended before it was armed"
        os.killpg(node.pid, number)
        out, errors = node.communicate(timeout=ENDS_WITHIN_S)

    assert node.returncode == 0
    assert errors.splitlines() == [f"segway-ecc: stopped: {number.name}"]
    assert len(logged(path)) == json.loads(out)["cycles"]
