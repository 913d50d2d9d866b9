# SPDX-License-Identifier: MIT
"""`segway-ecc log replay`: identical, or what differs first."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from matplotlib.figure import Figure
from mcap.reader import make_reader
from mcap.writer import Writer
from msgspec.structs import replace

from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord, Inbox, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.cycle_message import cycle_of
from segway_ecc.node.recording.layout import LogEnd, LogPart, Provenance, layout_of
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.recording.salvage import Salvage
from segway_ecc.node.replay.recorded import RecordedRun
from segway_ecc.node.robot import build_robot
from tests.drawn_texts import bare_axes, overlapping, texts_of
from tests.node.replay.conftest import Script

Run = Callable[..., Any]


@pytest.fixture
def log(segway_ecc: Run, tmp_path: Path) -> Path:
    """The log of a drive over a simulated bus."""
    path = tmp_path / "field.mcap"
    assert segway_ecc(
        "prove", "fault", "disk-fails", "--set", "plant.MotorResistance=0.4", "--log", str(path)
    ).code in {0, 1, 3}
    assert segway_ecc("prove", "fault", "can-cut", "--robot", "cart-can", "--log", str(path)).code == 0
    return path


def rewritten(log: Path, change: Callable[[CycleRecord], CycleRecord | None]) -> Path:
    """The log with its cycles changed, or left out."""
    run, path = RecordedRun(log), log.with_name("changed.mcap")
    with log.open("rb") as stream:
        reader = make_reader(stream)
        attachments = {found.name: found.data.decode() for found in reader.iter_attachments()}
        metadata = {found.name: found.metadata for found in reader.iter_metadata()}
    del attachments["layout.json"], metadata["robot"], metadata["counts"]
    made = CycleLog(path, run.layout, Provenance(attachments, metadata))
    for record in run.cycles():
        changed = change(record)
        if changed is not None:
            made.write(changed)
    made.close()
    return path


def pushed(record: CycleRecord) -> CycleRecord:
    return replace(record, commands=(record.commands[0] + 0.5, record.commands[1])) if record.cycle == 50 else record


def test_a_log_from_the_field_is_identical(segway_ecc: Run, log: Path) -> None:
    outcome = segway_ecc("log", "replay", str(log))
    cycles = sum(1 for _ in RecordedRun(log).cycles())

    assert outcome.code == 0
    assert outcome.errors == []
    assert outcome.out.startswith(f"identical: {cycles} cycles, ")


def test_the_model_is_known_where_nothing_has_loaded_it_yet(log: Path) -> None:
    words = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", "log", "replay", str(log)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_first_difference_is_reported_with_exit_code_1(segway_ecc: Run, log: Path) -> None:
    outcome = segway_ecc("log", "replay", str(rewritten(log, pushed)))
    lines = outcome.out.splitlines()

    assert outcome.code == 1
    assert lines[0].startswith("cycle 50 (t = 0.500 s): command left.voltage ")
    assert lines[0].endswith(" is computed")
    assert lines[1] == "50 cycles before it are identical"
    assert [line.split(":")[0].strip() for line in lines[4:]] == [str(cycle) for cycle in range(46, 56)]


def test_json_tells_the_same(segway_ecc: Run, log: Path) -> None:
    good = json.loads(segway_ecc("log", "replay", str(log), "--json").out)
    bad = json.loads(segway_ecc("log", "replay", str(rewritten(log, pushed)), "--json").out)

    assert (good["identical"], good["difference"], good["gap"], good["cut"], good["other_model"]) == (
        True,
        None,
        None,
        False,
        False,
    )
    assert (bad["identical"], bad["cycles"]) == (False, 50)
    assert (bad["difference"]["cycle"], bad["difference"]["port"]) == (50, "command left.voltage")
    assert float(bad["difference"]["recorded"]) - float(bad["difference"]["computed"]) == pytest.approx(0.5)


def test_missing_cycles_are_located_with_exit_code_9(segway_ecc: Run, log: Path) -> None:
    cycles = sum(1 for _ in RecordedRun(log).cycles())
    outcome = segway_ecc("log", "replay", str(rewritten(log, lambda record: None if record.cycle == 30 else record)))

    assert outcome.code == 9
    assert outcome.out.startswith("identical: 30 cycles")
    assert outcome.out.endswith("compared: cycles 0 to 29\n")
    why = "the state is not known before the next snapshot"
    assert outcome.errors == [
        "segway-ecc: cycles 30 to 30 are missing in the log",
        f"segway-ecc: {cycles - 31} cycles are whole and could not be compared: {why}",
    ]


def copied(log: Path, keep: Callable[[str, bytes], bool], change: Callable[[bytes], bytes] = bytes) -> Path:
    """The log made anew by a tool of its own, whole in itself: with the messages to keep, and its end changed."""
    path = log.with_name("copied.mcap")
    with log.open("rb") as stream, path.open("wb") as out:
        reader, made = make_reader(stream), Writer(out)
        made.start(profile="ros2")
        channels: dict[str, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if schema is None or not keep(channel.topic, message.data):
                continue
            if channel.topic not in channels:
                number = made.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = made.register_channel(channel.topic, channel.message_encoding, number)
            made.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        for found in reader.iter_attachments():
            data = change(found.data) if found.name == "end.json" else found.data
            made.add_attachment(found.create_time, found.log_time, found.name, found.media_type, data)
        for values in reader.iter_metadata():
            if not values.name.startswith("channel "):
                made.add_metadata(values.name, values.metadata)
        made.finish()  # type: ignore[no-untyped-call]  # mcap annotates arguments, and this has none
    return path


def test_a_log_without_its_last_cycles_says_which_are_missing(segway_ecc: Run, log: Path) -> None:
    last = max(record.cycle for record in RecordedRun(log).cycles())
    outcome = segway_ecc(
        "log", "replay", str(copied(log, lambda topic, data: topic != "/cycle" or cycle_of(data) < 100))
    )

    assert outcome.code == 9
    assert outcome.out.startswith("identical: 100 cycles")
    assert f"segway-ecc: cycles 100 to {last} are missing in the log" in outcome.errors
    lacks = f"segway-ecc: copied.mcap: {last - 99} of {last + 1} messages on /cycle are missing"
    assert lacks in outcome.errors


def test_a_log_without_its_snapshots_says_how_many_are_missing(segway_ecc: Run, log: Path) -> None:
    there = sum(topic == "/state" for topic, _ in Salvage(log).messages())
    outcome = segway_ecc("log", "replay", str(copied(log, lambda topic, _: topic != "/state")))

    assert there > 0
    assert outcome.code == 9
    assert outcome.errors == [f"segway-ecc: copied.mcap: {there} of {there} messages on /state are missing"]


def test_a_copy_that_lacks_nothing_and_an_end_of_an_older_version_are_whole(segway_ecc: Run, log: Path) -> None:
    def older(end: bytes) -> bytes:
        return msgspec.json.encode(msgspec.json.decode(end, type=LogPart))

    outcome = segway_ecc("log", "replay", str(copied(log, lambda _topic, _data: True, older)))
    assert (outcome.code, outcome.errors) == (0, [])


def test_an_end_of_another_file_is_reported(segway_ecc: Run, log: Path) -> None:
    def other(end: bytes) -> bytes:
        return msgspec.json.encode(replace(msgspec.json.decode(end, type=LogEnd), number=3))

    outcome = segway_ecc("log", "replay", str(copied(log, lambda _topic, _data: True, other)))
    assert outcome.code == 9
    assert outcome.errors == ["segway-ecc: copied.mcap: its end is that of part 3, and it is part 1"]


def test_truncated_log_is_replayed_up_to_its_end_with_exit_code_9(segway_ecc: Run, log: Path) -> None:
    log.write_bytes(log.read_bytes()[:-50])
    outcome = segway_ecc("log", "replay", str(log))

    assert outcome.code == 9
    assert outcome.out.startswith("identical: ")
    assert outcome.errors == [
        "segway-ecc: the log ends before its time, as after a power cut or a killed node: replayed up to there"
    ]


def test_another_model_is_warned_of_and_may_differ(segway_ecc: Run, log: Path, tmp_path: Path) -> None:
    (tmp_path / "half_model.py").write_text(
        "from segway_ecc.node.models.cart import CartController\n"
        "class Half(CartController):\n"
        "    def output(self):\n"
        "        return [0.5 * y for y in super().output()]\n"
    )
    outcome = segway_ecc("log", "replay", str(log), "--model", "half_model:Half")

    assert outcome.code == 1
    assert outcome.errors == ["segway-ecc: the model is not the one that ran: its files have another content"]


def test_commands_are_drawn_as_recorded_and_as_computed(
    segway_ecc: Run, log: Path, tmp_path: Path, drawn: list[Figure]
) -> None:
    assert segway_ecc("log", "replay", str(log), "--plot", str(tmp_path / "a.svg")).code == 0
    (axes,) = drawn[0].axes
    assert axes.get_ylabel() == "V"
    assert [line.get_label() for line in axes.lines] == [
        f"{side}.voltage, {layer}" for side in ("left", "right") for layer in ("recorded", "computed")
    ]
    assert (tmp_path / "a.svg").stat().st_size > 10_000


def test_of_a_robot_without_commands_the_outputs_of_its_model_are_drawn(
    segway_ecc: Run, tmp_path: Path, drawn: list[Figure]
) -> None:
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    path = tmp_path / "cart.mcap"
    script = Script({5: Inbox(setpoints=[StampedSetpoint(Setpoint(1.0, 0.5), None)])})
    robot.loop(script, CycleLog(path, layout_of(robot), provenance_of(robot.file))).run(80)
    assert segway_ecc("log", "replay", str(path), "--plot", str(tmp_path / "a.png")).code == 0

    (figure,) = drawn
    names = {str(line.get_label()).partition(",")[0] for axes in figure.axes for line in axes.lines}
    assert names == {variable.name for variable in robot.model.outputs}
    assert {axes.get_ylabel() for axes in figure.axes} == {"m", "rad", "m/s", "rad/s"}
    assert bare_axes(figure) == []
    assert overlapping(texts_of(figure)) == []


def test_where_nothing_was_compared_nothing_is_drawn(segway_ecc: Run, log: Path, tmp_path: Path) -> None:
    plot = tmp_path / "a.png"
    outcome = segway_ecc("log", "replay", str(rewritten(log, lambda _: None)), "--plot", str(plot))
    assert outcome.code == 9
    assert outcome.errors[-1] == f"segway-ecc: nothing was compared, so {plot} is not drawn"
    assert not plot.exists()


def test_what_is_no_log_ends_it_with_9(segway_ecc: Run, tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_text("x")
    none, other = (
        segway_ecc("log", "replay", str(tmp_path / "no.mcap")),
        segway_ecc("log", "replay", str(tmp_path / "x.mcap")),
    )

    assert (none.code, other.code) == (9, 9)
    assert none.errors == [f"segway-ecc: cannot read the log {tmp_path}/no.mcap: No such file or directory"]
    assert "it is no log of a run" in other.errors[0]


def test_the_campaign_replays_its_runs(segway_ecc: Run, tmp_path: Path) -> None:
    scenario = tmp_path / "cut.yaml"
    scenario.write_text(
        "name: cut\nrobot: cart-can\nsegments: [{linear: 1.0, duration: 0.5}]\n"
        "faults: [{target: can, type: off, at_s: 0.2}]\nexpect: {outcome: faults}\n"
    )
    outcome = segway_ecc("prove", "campaign", str(scenario), "--jobs", "1", "--seeds", "2", "--replay")

    assert outcome.code == 0
    assert outcome.errors[-2] == "segway-ecc: 2 of 2 replays are identical to the last bit"


def test_a_replay_that_differs_is_not_as_expected(
    segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = CycleLog.write
    monkeypatch.setattr(CycleLog, "write", lambda log, record: write(log, pushed(record)))
    scenario = tmp_path / "plain.yaml"
    scenario.write_text(
        "name: plain\nrobot: cart-can\nsegments: [{linear: 1.0, duration: 0.5}]\n"
        "faults: [{target: commands, type: off, at_s: 0.2}]\nexpect: {outcome: holds}\n".replace(
            "commands", "command_link"
        )
    )
    outcome = segway_ecc("prove", "campaign", str(scenario), "--jobs", "1", "--replay", "--json")
    (run,) = json.loads(outcome.out)["runs"]

    assert outcome.code == 1
    assert any(why.startswith("replay: cycle 50 (t = 0.500 s): command left.voltage ") for why in run["why_not"])
    assert msgspec.json.encode(run)


def test_a_log_without_a_cycle_is_not_identical(segway_ecc: Run, log: Path) -> None:
    outcome = segway_ecc("log", "replay", str(rewritten(log, lambda _: None)))

    assert (outcome.code, outcome.out) == (9, "nothing was compared\n")
    assert outcome.errors == ["segway-ecc: there is no cycle in the log"]


def test_a_drawing_that_cannot_be_written_is_reported(segway_ecc: Run, log: Path) -> None:
    outcome = segway_ecc("log", "replay", str(log), "--plot", "/dev/full")

    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.errors == ["segway-ecc: cannot draw /dev/full: [Errno 28] No space left on device"]
