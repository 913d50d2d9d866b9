# SPDX-License-Identifier: MIT
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.command import Outcome

SegwayEcc = Callable[..., Outcome]


@pytest.fixture(autouse=True)
def _no_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is on this machine's network is no part of these tests."""
    monkeypatch.setattr("segway_ecc.node.ros.runtime.missing_packages", lambda: ["rclpy"])


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    place = tmp_path / "logs"
    place.mkdir()
    for age, name in enumerate(("new.mcap", "old.mcap")):
        (place / name).write_bytes(b"log")
        os.utime(place / name, ns=(0, 10**18 - age))
    return place


def test_a_bundle_is_made_and_shown(segway_ecc: SegwayEcc, tmp_path: Path, logs: Path) -> None:
    out = tmp_path / "b.zip"
    outcome = segway_ecc("log", "bundle", "cart", "--out", str(out), "--log-folder", str(logs))
    assert (outcome.code, outcome.errors) == (0, [])
    rows = dict(line.split("  ", 1) for line in outcome.out.splitlines())
    assert rows["logs"].strip() == "logs/new.mcap (0 KiB)"
    assert rows["robot file"].strip().startswith("robot.yaml")
    assert rows["robots"].strip().startswith("not: RosUnavailableError: ROS 2 is not available here")
    assert rows["bundle"].strip().startswith(str(out))
    with zipfile.ZipFile(out) as archive:
        assert archive.testzip() is None
        assert {"robot.yaml", "versions.json", "logs/new.mcap", "MANIFEST.json"} <= set(archive.namelist())


def test_json_is_the_manifest(segway_ecc: SegwayEcc, tmp_path: Path, logs: Path) -> None:
    out = tmp_path / "b.zip"
    words = ("--out", str(out), "--log-folder", str(logs), "--logs", "5", "--station", str(tmp_path), "--json")
    report = json.loads(segway_ecc("log", "bundle", *words).out)
    assert (report["file"], report["bytes"]) == (str(out), out.stat().st_size)
    with zipfile.ZipFile(out) as archive:
        assert json.loads(archive.read("MANIFEST.json"))["parts"] == report["parts"]
    parts = {part["part"]: part for part in report["parts"]}
    assert [file["name"] for file in parts["logs"]["files"]] == ["logs/new.mcap", "logs/old.mcap"]
    assert parts["audit log"]["missing"] == [f"there is no audit log in {tmp_path}"]
    assert "robot file" not in parts


def test_a_robot_file_that_is_not_as_it_must_be_is_put_in_all_the_same(
    segway_ecc: SegwayEcc, tmp_path: Path, logs: Path
) -> None:
    robot = tmp_path / "bad.yaml"
    robot.write_text("nonsense: [")
    out = tmp_path / "b.zip"
    words = (str(robot), "--out", str(out), "--log-folder", str(logs), "--logs", "0")
    assert segway_ecc("log", "bundle", *words).code == 0
    with zipfile.ZipFile(out) as archive:
        assert archive.read("robot.yaml") == b"nonsense: ["
        assert not [name for name in archive.namelist() if name.startswith("logs/")]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--logs", "-1"], "--logs is 0 to 1000"),
        (["--logs", "1001"], "--logs is 0 to 1000"),
        (["nowhere.yaml"], "cannot read robot file 'nowhere.yaml'"),
        (["--logs", "0", "--out", "/dev/null/b.zip"], "--out /dev/null/b.zip cannot be written: Not a directory"),
    ],
)
def test_invalid_arguments_are_reported_in_one_line(segway_ecc: SegwayEcc, words: list[str], message: str) -> None:
    outcome = segway_ecc("log", "bundle", *words)
    assert outcome.code == 2
    (line,) = outcome.errors
    assert message in line


def test_without_a_name_it_goes_here_by_robot_and_time(
    segway_ecc: SegwayEcc, tmp_path: Path, logs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert segway_ecc("log", "bundle", "cart", "--log-folder", str(logs)).code == 0
    (found,) = tmp_path.glob("segway-ecc-support-cart-2*Z.zip")
    assert found.stat().st_mode & 0o777 == 0o600
