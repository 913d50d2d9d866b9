# SPDX-License-Identifier: MIT
"""What the robot's side refuses, keeps and removes."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.deploy.release.agent.store import ReleaseManifest
from segway_ecc.deploy.release.host import Event, UpdateRefusedError
from segway_ecc.node.errors import ConfigurationError
from tests.deploy.release.parts import make_bundle
from tests.deploy.release.robot import LocalHost, Robot

RUNNING = {"LoadState": "loaded", "ActiveState": "active", "SubState": "running", "MainPID": "7"}


def status_text(mode: str) -> str:
    return json.dumps({"mode": mode, "rate_hz": 200.0, "blocked_by": []})


@pytest.mark.parametrize("mode", ["ARMED", "HOLD"])
def test_an_armed_robot_is_left_alone(robot: Robot, local: LocalHost, mode: str) -> None:
    robot.push(local, "1.0")
    robot.node_is(**RUNNING, StatusText=status_text(mode))
    restarts = robot.calls().count("restart -- segway-ecc-node.service")
    with pytest.raises(UpdateRefusedError, match=f"the robot is {mode}: disarm it first"):
        robot.push(local, "2.0")
    with pytest.raises(UpdateRefusedError, match=f"the robot is {mode}: disarm it first"):
        robot.rollback(local)
    assert str(robot.store.current()).startswith("1.0-")
    assert robot.calls().count("restart -- segway-ecc-node.service") == restarts == 1


def test_a_robot_that_is_armed_during_the_installation_is_not_restarted(robot: Robot, local: LocalHost) -> None:
    robot.push(local, "1.0")

    def arm(event: Event) -> None:
        if event["event"] == "ready":
            robot.node_is(**RUNNING, StatusText=status_text("ARMED"))

    with pytest.raises(UpdateRefusedError, match="disarm it first"):
        robot.push(local, "2.0", arm)
    assert str(robot.store.current()).startswith("1.0-")
    assert robot.journal.pending() is None
    robot.node_is(**RUNNING, StatusText=status_text("DISARMED"))
    asked: list[Any] = []
    robot.push(local, "2.0", lambda event: asked.append(event["event"]))
    assert "need" not in asked, "it was installed already"
    assert str(robot.store.current()).startswith("2.0-")


def test_a_robot_without_our_services_is_refused_before_anything_is_sent(robot: Robot, local: LocalHost) -> None:
    robot.node_is(LoadState="not-found", ActiveState="inactive")
    with pytest.raises(UpdateRefusedError, match=r"segway-ecc-node\.service is not installed there \(not-found\)"):
        robot.push(local, "1.0")
    assert list(robot.store.releases.iterdir()) == []


def test_a_release_can_be_read_by_the_user_that_the_node_runs_as(robot: Robot, local: LocalHost) -> None:
    old = os.umask(0o077)
    robot.push(local, "1.0", robot="name: one\n")
    os.umask(old)
    folder = robot.store.folder(str(robot.store.current()))
    assert all(path.stat().st_mode & 0o044 == 0o044 for path in folder.rglob("*"))


def test_node_without_reported_mode_counts_as_armed(robot: Robot, local: LocalHost) -> None:
    robot.node_is(**RUNNING, StatusText="")
    with pytest.raises(UpdateRefusedError, match="does not report whether the robot is armed"):
        robot.push(local, "1.0")


@pytest.mark.variants(1)
@pytest.mark.parametrize(
    ("version", "reason"),
    [
        ("2.0+bad", "the robot is in FAULT: told so"),
        ("2.0+slow", "its loop runs at 190 Hz instead of 200 Hz"),
        ("2.0+mute", "reports no status"),
        ("2.0+refused", "Job for it failed"),
    ],
)
def test_what_is_not_healthy_is_taken_back_once_and_not_tried_again(
    robot: Robot, local: LocalHost, version: str, reason: str
) -> None:
    robot.push(local, "1.0")
    ended = robot.push(local, version)
    assert (ended["outcome"], str(ended["current"])[:4]) == ("went-back", "1.0-")
    assert reason in ended["reason"]
    assert sum(call.startswith("restart") for call in robot.calls()) == 3, "started, tried, gone back: no flapping"
    with pytest.raises(UpdateRefusedError, match=r"failed before.*--again"):
        robot.push(local, version)
    assert robot.push(local, version, again=True)["outcome"] == "went-back"
    robot.check_works()


def test_unhealthy_first_release_stays_and_is_reported(robot: Robot, local: LocalHost) -> None:
    ended = robot.push(local, "1.0+bad")
    assert (ended["outcome"], ended["previous"]) == ("no-way-back", None)
    ended = robot.push(local, "1.1+bad")
    assert (ended["outcome"], ended["previous"]) == ("no-way-back", None), "never back to what failed"
    assert robot.push(local, "1.2")["outcome"] == "healthy"


def test_a_robot_that_is_armed_in_a_trial_that_fails_is_restarted_only_once_disarmed(
    robot: Robot, local: LocalHost
) -> None:
    robot.push(local, "1.0")
    waits: list[str] = []

    def arm(event: Event) -> None:
        step = event.get("step", "")
        if step == "trial":
            robot.node_is(**RUNNING, NRestarts="1", StatusText=status_text("ARMED"))
        elif step.startswith("waiting"):
            waits.append(str(robot.store.current()))
            robot.node_is(**RUNNING, StatusText=status_text("DISARMED"))

    assert robot.push(local, "2.0+mute", arm, rules={"trial_s": 0.1, "start_s": 60.0})["outcome"] == "went-back"
    assert waits
    assert {name.partition("-")[0] for name in waits} == {"2.0+mute"}, "while it was armed nothing changed"


def test_a_version_that_cannot_be_installed_or_loaded_changes_nothing(robot: Robot, local: LocalHost) -> None:
    robot.push(local, "1.0", robot="name: a\n")
    with pytest.raises(UpdateRefusedError, match="ended with 1: ERROR: no"):
        robot.push(local, "2.0+unbuildable")
    with pytest.raises(UpdateRefusedError, match="the robot file does not load"):
        robot.push(local, "2.0", robot="unloadable\n")
    assert str(robot.store.current()).startswith("1.0-")
    assert (robot.config / "robot.yaml").read_text() == "name: a\n"
    assert sum(call.startswith("restart") for call in robot.calls()) == 1
    robot.check_works()


def test_old_releases_are_pruned_but_not_what_a_rollback_needs(robot: Robot, local: LocalHost) -> None:
    for version in ("1.0", "2.0", "3.0", "4.0+bad", "5.0+bad", "6.0+bad"):
        robot.push(local, version)
    kept = [manifest.version for manifest in robot.store.complete()]
    assert kept == ["2.0", "3.0", "5.0+bad", "6.0+bad"], "in use, the one before it, and the two newest"
    assert sorted(folder.name for folder in robot.store.releases.iterdir()) == sorted(
        manifest.name for manifest in robot.store.complete()
    )
    assert robot.rollback(local)["current"] == robot.store.complete()[0].name


def test_release_with_ros_sets_its_library_path(robot: Robot, local: LocalHost) -> None:
    """In a file that the units read, and that belongs to it like any other."""
    name = robot.push(local, "1.0+ros")["current"]
    text = (robot.root / "current" / "environment").read_text()
    place = robot.store.folder(name) / "venv" / "lib"
    (site,) = place.glob("python3*/site-packages")
    assert text.splitlines()[-1] == f"LD_LIBRARY_PATH={place}:{site}/ros_rclpy.libs"
    manifest = robot.store.manifest(name)
    assert manifest is not None
    assert "environment" in manifest.files
    robot.push(local, "2.0")
    assert not (robot.root / "current" / "environment").exists()


def test_two_at_once_are_refused(robot: Robot, local: LocalHost) -> None:
    refused: list[str] = []

    def push_too(event: Event) -> None:
        # Before the switch the robot waits for our go; its trial lasts until the node reports.
        at = event.get("step", event["event"])
        if at in {"ready", "trial"}:
            with LocalHost(robot) as other, pytest.raises(UpdateRefusedError, match="another update is under way"):
                robot.push(other, "2.0")
            refused.append(at)
            robot.node_is(**RUNNING, StatusText=status_text("DISARMED"))

    rules = {"trial_s": 0.1, "start_s": 60.0, "keep": 2}
    assert robot.push(local, "1.0+mute", push_too, rules=rules)["outcome"] == "healthy"
    assert refused == ["ready", "trial"]
    assert robot.push(local, "2.0")["outcome"] == "healthy"


def test_release_that_prints_another_version_is_refused(robot: Robot, local: LocalHost) -> None:
    robot.push(local, "1.0")
    request, files = robot.push_request("2.0")
    request["release"]["version"] = "2.1"
    with pytest.raises(UpdateRefusedError, match=r"--version prints '2\.0', not '2\.1'"):
        local.ask(request, lambda _: None, files)
    robot.check_works()


def test_a_full_disk_is_refused_before_anything_is_sent(robot: Robot, local: LocalHost) -> None:
    request, files = robot.push_request("1.0")
    request["release"]["files"]["wheels/large.whl"] = {"sha256": "0" * 64, "size": 10**15}
    events: list[str] = []
    with pytest.raises(UpdateRefusedError, match=r"MB free and 40000000\d\d MB are needed"):
        local.ask(request, lambda event: events.append(event["event"]), files)
    assert "need" not in events


@pytest.mark.parametrize(
    "path", ["../evil", "/etc/passwd", "wheels/../../evil", "wheels/.hidden", "wheels//x", "a b", ""]
)
def test_a_path_that_leads_elsewhere_is_refused(robot: Robot, local: LocalHost, path: str) -> None:
    request, files = robot.push_request("1.0")
    request["release"]["files"][path] = {"sha256": "0" * 64, "size": 1}
    with pytest.raises(UpdateRefusedError, match="is no path within a release"):
        local.ask(request, lambda _: None, files)


@pytest.mark.parametrize("name", ["../1.0", ".hidden", "a/b", "", "x" * 101, "a;b"])
def test_a_name_that_is_none_is_refused(robot: Robot, local: LocalHost, name: str) -> None:
    request, files = robot.push_request("1.0")
    request["release"]["name"] = name
    with pytest.raises(UpdateRefusedError, match="is no name of a release"):
        local.ask(request, lambda _: None, files)


def test_what_arrives_damaged_is_refused(robot: Robot, local: LocalHost) -> None:
    robot.push(local, "1.0")
    request, files = robot.push_request("2.0")
    wheel = files["wheels/segway_ecc-2.0-py3-none-any.whl"]
    wheel.write_bytes(wheel.read_bytes()[:-1] + b"x")
    with pytest.raises(UpdateRefusedError, match="did not arrive whole"):
        local.ask(request, lambda _: None, files)
    wheel.write_bytes(b"x")
    with pytest.raises(ConfigurationError, match="became shorter"):
        local.ask(request, lambda _: None, files)
    robot.wait_until_settled()
    robot.check_works()
    assert robot.push(local, "2.0")["outcome"] == "healthy"


def test_a_release_that_was_changed_by_hand_is_not_gone_back_to(robot: Robot, local: LocalHost) -> None:
    robot.push(local, "1.0")
    robot.push(local, "2.0")
    first = robot.store.complete()[0].name
    next((robot.store.folder(first) / "venv").rglob("stand_in.py")).write_text("changed")
    with pytest.raises(UpdateRefusedError, match=r"stand_in\.py was changed; push it again"):
        robot.rollback(local)
    assert robot.push(local, "1.0")["outcome"] == "healthy", "pushed again it is whole"
    robot.check_works()


def test_a_release_in_use_that_was_changed_by_hand_is_not_called_healthy(robot: Robot, local: LocalHost) -> None:
    robot.push(local, "1.0")
    next((robot.root / "current" / "venv").resolve().rglob("stand_in.py")).write_text("changed")
    with pytest.raises(UpdateRefusedError, match="is in use and was changed by hand"):
        robot.push(local, "1.0")


def test_the_robot_file_goes_with_the_release_and_back_with_it(robot: Robot, local: LocalHost) -> None:
    machine = robot.config / "robot.yaml"
    robot.push(local, "1.0")
    assert not machine.is_symlink(), "a push without a robot file leaves the machine's alone"
    robot.push(local, "2.0", robot="name: two\n")
    assert machine.read_text() == "name: two\n"
    robot.rollback(local)
    assert machine.read_text() == "name: of the machine\n"
    assert (robot.config / "robot.yaml.before-deploy").read_text() == "name: of the machine\n"
    assert machine.resolve().parent == robot.config, "where the models stand that it names"
    robot.check_works()


def test_a_push_that_brings_no_robot_file_names_the_one_in_use(robot: Robot, local: LocalHost) -> None:
    robot.push(local, "1.0", robot="name: one\n")
    probe = {"verb": "probe", "root": str(robot.root), "config": str(robot.config)}
    held = local.ask(probe, lambda _: None)["robot_files"]
    assert list(held) == ["robot/robot.yaml"]
    request, files = robot.push_request("2.0")
    request["release"]["files"] |= held
    assert local.ask(request, lambda _: None, files)["outcome"] == "healthy"
    assert (robot.config / "robot.yaml").read_text() == "name: one\n"
    assert "robot/robot.yaml" in (robot.store.manifest(str(robot.store.current())) or ReleaseManifest("")).files


def test_the_restart_command_is_words_and_no_shell(robot: Robot, local: LocalHost, tmp_path: Path) -> None:
    rules = {"trial_s": 0.1, "start_s": 0.3, "keep": 2, "restart": ["systemctl", "restart", f"x;touch {tmp_path}/evil"]}
    assert robot.push(local, "1.0", rules=rules)["outcome"] == "healthy"
    assert f"restart x;touch {tmp_path}/evil" in robot.calls()
    assert not (tmp_path / "evil").exists()


def test_an_installation_of_other_content_has_another_name(tmp_path: Path) -> None:
    (one, _), (two, _) = make_bundle(tmp_path, "1.0", robot="a"), make_bundle(tmp_path, "1.0", robot="b")
    assert one.name != two.name
    assert one.name == make_bundle(tmp_path, "1.0", robot="a")[0].name
