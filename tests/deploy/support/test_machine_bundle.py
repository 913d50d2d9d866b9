# SPDX-License-Identifier: MIT
"""The parts of a machine, each on its own."""

import json
import os
import zipfile
from pathlib import Path

import pytest

from segway_ecc.deploy.station.station_bundle import robots
from segway_ecc.deploy.support import machine_bundle as machine
from segway_ecc.deploy.support.bundle import MANIFEST, Collected, Stored, write_bundle
from segway_ecc.deploy.support.commands import NoAnswerError, answer_of
from segway_ecc.deploy.support.machine_bundle import BundleOptions, audit_log, machine_parts, newest_logs

SECRET = "s3cr3t-value"  # noqa: S105 - nobody's


def _program(folder: Path, name: str, script: str) -> None:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of programs, which are the only ones that there are."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    return folder


def test_missing_failing_or_hanging_program_is_reported_in_one_line(programs: Path) -> None:
    with pytest.raises(NoAnswerError, match="there is no program ip here"):
        answer_of(["ip"])
    _program(programs, "ip", "echo one >&2; echo two >&2; exit 3")
    with pytest.raises(NoAnswerError, match=r"^ip: two$"):
        answer_of(["ip"])
    _program(programs, "ip", "exit 3")
    with pytest.raises(NoAnswerError, match=r"^ip: exit code 3$"):
        answer_of(["ip"])
    _program(programs, "ip", "exec /bin/sleep 60")
    with pytest.raises(NoAnswerError, match=r"ip gave no answer within 0\.2 s"):
        answer_of(["ip"], 0.2)


def test_interfaces_are_asked_for_with_their_counters(programs: Path) -> None:
    _program(programs, "ip", 'echo "$@"')
    assert machine.can_interfaces().files == {"interfaces.txt": "-details -statistics link\n"}


def test_the_journal_of_our_units_is_asked_for_and_an_empty_one_is_named(programs: Path) -> None:
    _program(programs, "journalctl", 'case "$*" in *--unit*) echo "$@";; esac')
    found = machine.journal()
    text = found.files["messages.txt"]
    assert isinstance(text, str)
    assert "--lines=2000" in text
    assert "--unit segway-ecc*" in text
    assert found.missing == ["kernel.txt: the journal has none, or does not show them to this user"]


def test_missing_journal_is_reported(programs: Path) -> None:
    assert list(programs.iterdir()) == []
    found = machine.journal()
    assert found.files == {}
    assert found.missing[0] == "messages.txt: there is no program journalctl here"


def test_the_newest_logs_that_fit(tmp_path: Path) -> None:
    for age, (name, size) in enumerate({"a": 10, "b": 2**21, "c": 5, "d": 1}.items()):
        (tmp_path / name).write_bytes(bytes(size))
        os.utime(tmp_path / name, ns=(0, 10**18 - age))
    found = newest_logs(tmp_path, 3, 2**20)
    assert list(found.files) == ["logs/a", "logs/c"]
    assert all(isinstance(content, Stored) for content in found.files.values())
    assert found.missing == ["b: 2.0 MiB are more than the 1.0 MiB that are left"]
    assert newest_logs(tmp_path / "none", 1, 1) == Collected({}, [f"there is no log in {tmp_path / 'none'}"])


def test_the_newest_log_may_be_wanted_of_one_robot(tmp_path: Path) -> None:
    for age, robot in enumerate(("arm", "cart")):
        (tmp_path / f"{robot}-20261126T101500Z-12.mcap").write_bytes(b"0")
        os.utime(tmp_path / f"{robot}-20261126T101500Z-12.mcap", ns=(0, 10**18 - age))
    assert list(newest_logs(tmp_path, 1, 9).files) == ["logs/arm-20261126T101500Z-12.mcap"]
    assert list(newest_logs(tmp_path, 1, 9, ["cart"]).files) == ["logs/cart-20261126T101500Z-12.mcap"]


def test_of_a_station_only_the_audit_log(tmp_path: Path) -> None:
    (tmp_path / "access.json").write_text(SECRET)
    (tmp_path / "audit.jsonl").write_text('{"who": "ann"}\n')
    (tmp_path / "audit.1.jsonl").write_text("older\n")
    (tmp_path / "audit.9.jsonl").symlink_to(tmp_path / "access.json")
    assert audit_log(tmp_path).files == {"audit/audit.jsonl": '{"who": "ann"}\n', "audit/audit.1.jsonl": "older\n"}
    assert audit_log(tmp_path / "none").missing == [f"there is no audit log in {tmp_path / 'none'}"]


def test_limits_disks_and_versions_are_had_on_any_linux(tmp_path: Path) -> None:
    limits = json.loads(str(machine.real_time().files["machine.json"]))
    assert "real-time priority" in limits["limits, soft and hard"]
    assert "/proc/loadavg" in limits["facts"]
    found = machine.disks([tmp_path, tmp_path / "nowhere"])
    assert json.loads(str(found.files["disks.json"]))[str(tmp_path)]["free"] > 0
    assert found.missing == [f"{tmp_path / 'nowhere'}: No such file or directory"]


def test_no_secret_is_anywhere_in_a_whole_bundle(
    tmp_path: Path, programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _program(
        programs, "journalctl", f"echo 'new tokens'; echo '  operator  {SECRET}-0123456789'; echo password={SECRET}"
    )
    _program(programs, "ip", f"echo 'wpa_psk={SECRET}'")
    for name in ("ROS_TOKEN", "GITHUB_TOKEN", "MY_PASSWORD", "AWS_SECRET_ACCESS_KEY", "ROS_SECURITY_KEYSTORE"):
        monkeypatch.setenv(name, SECRET)
    monkeypatch.setenv("ROS_STATIC_PEERS", f"http://ann:{SECRET}@here token={SECRET}")
    monkeypatch.setattr("segway_ecc.node.ros.runtime.missing_packages", lambda: ["rclpy"])
    station = tmp_path / "station"
    station.mkdir()
    (station / "access.json").write_text(SECRET)
    (station / "audit.jsonl").write_text(json.dumps({"who": "ann", "token": SECRET}))
    options = BundleOptions(tmp_path / "logs", robot=f"name: cart\napi_key: {SECRET}\n", station=station, robots=robots)
    parts = machine_parts(options)
    path = tmp_path / "b.zip"
    manifest = write_bundle(path, {**parts, "broken": _fail}, {}, "now")

    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        found = [name for name in names if SECRET.encode() in archive.read(name)]
        environment = json.loads(archive.read("environment.json"))
    assert found == []
    assert {"versions.json", "robot.yaml", "interfaces.txt", "messages.txt", "audit/audit.jsonl", MANIFEST} <= set(
        names
    )
    assert "access.json" not in " ".join(names)
    assert not {"ROS_TOKEN", "GITHUB_TOKEN", "ROS_SECURITY_KEYSTORE"} & set(environment)
    states = {part.part: part.state for part in manifest.parts}
    assert (states["robots"], states["logs"], states["broken"]) == ("missing", "missing", "missing")
    assert states["versions"] == "complete"


def _fail() -> Collected:
    raise RuntimeError(f"password={SECRET}")
