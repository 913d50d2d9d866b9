# SPDX-License-Identifier: MIT
"""`segway-ecc log repair`: a whole log of what is left of one."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.mcap_log import McapLog
from segway_ecc.node.recording.salvage import Salvage

Run = Callable[..., Any]


@pytest.fixture
def log(segway_ecc: Run, tmp_path: Path) -> Path:
    """The log of a drive over a simulated bus."""
    path = tmp_path / "field.mcap"
    assert segway_ecc("prove", "fault", "can-cut", "--robot", "cart-can", "--log", str(path)).code == 0
    return path


def cycles_in(path: Path) -> int:
    """As the reader finds them that goes by the index."""
    with path.open("rb") as stream:
        return sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages(["/cycle"]))


def test_a_log_that_was_cut_off_is_repaired_for_every_reader(segway_ecc: Run, log: Path, tmp_path: Path) -> None:
    whole = cycles_in(log)
    log.write_bytes(log.read_bytes()[:-50])
    outcome = segway_ecc("log", "repair", str(log))
    repaired = tmp_path / "field.whole.mcap"

    assert outcome.code == 0
    assert outcome.errors == ["segway-ecc: the log ends before its time, as after a power cut"]
    assert outcome.out.startswith(f"{repaired}: ")
    assert cycles_in(repaired) == whole
    with AnyReader([repaired]) as reader:
        assert "/cycle" in {connection.topic for connection in reader.connections}
    replayed = segway_ecc("log", "replay", str(repaired))
    assert (replayed.code, replayed.out.split(",")[0]) == (9, f"identical: {whole} cycles")
    assert replayed.errors == [f"{outcome.errors[0]} or a killed node: replayed up to there"]
    assert segway_ecc("log", "repair", str(log)).errors == [
        f"segway-ecc: {repaired} is there already; choose another with --out"
    ]


def test_what_was_damaged_is_left_out_and_stays_reported(segway_ecc: Run, log: Path, tmp_path: Path) -> None:
    data = bytearray(log.read_bytes())
    data[len(data) // 2] ^= 0xFF
    log.write_bytes(data)
    source = Salvage(log)
    assert len(source.damage) == 1
    assert list(source.messages())
    damage = source.damage
    outcome = segway_ecc("log", "repair", str(log), "--out", str(tmp_path / "b.mcap"), "--json")
    report = json.loads(outcome.out)

    assert (outcome.code, report["damage"], report["cut"]) == (9, damage, False)
    assert damage[1].endswith(" are missing")
    assert Salvage(tmp_path / "b.mcap").damage == damage
    assert cycles_in(tmp_path / "b.mcap") == sum(topic == "/cycle" for topic, _ in Salvage(log).messages())


def test_a_whole_log_is_left_alone_and_what_is_none_is_refused(segway_ecc: Run, log: Path, tmp_path: Path) -> None:
    whole = segway_ecc("log", "repair", str(log))
    assert (whole.code, whole.out, list(tmp_path.iterdir())) == (0, "the log is whole\n", [log])

    (tmp_path / "x.mcap").write_text("not a log of anything")
    none = segway_ecc("log", "repair", str(tmp_path / "x.mcap"))
    assert none.code == 9
    assert none.errors[0].endswith("cannot be repaired: there is no message in it")


@pytest.mark.parametrize("at", ["add", "metadata"])
def test_a_repair_that_fails_leaves_no_file(
    segway_ecc: Run, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    def fail(*_: object) -> None:
        raise RecordingError("no space left")

    log.write_bytes(log.read_bytes()[:-50])
    monkeypatch.setattr(McapLog, at, fail)
    outcome = segway_ecc("log", "repair", str(log))

    assert (outcome.code, outcome.errors) == (9, ["segway-ecc: no space left"])
    assert list(tmp_path.iterdir()) == [log]


def test_a_log_whose_first_byte_is_damaged_is_not_taken_for_the_one_behind_it(log: Path) -> None:
    data = log.read_bytes()
    log.write_bytes(b"x" + data[1:] + data)
    found = Salvage(log)

    assert found.damage[0] == "field.mcap: its first 8 bytes are not those of an MCAP file"
    assert found.damage[-1] == f"field.mcap: another log begins at byte {len(data) + 8}, and is not read"
    assert found.topics


def test_a_log_behind_bytes_that_are_none_is_repaired(segway_ecc: Run, log: Path, tmp_path: Path) -> None:
    whole = cycles_in(log)
    log.write_bytes(b"from a shell: " + log.read_bytes())
    outcome = segway_ecc("log", "repair", str(log))

    assert outcome.code == 9
    assert outcome.errors == ["segway-ecc: field.mcap: its first 14 bytes are not of the log"]
    assert cycles_in(tmp_path / "field.whole.mcap") == whole
