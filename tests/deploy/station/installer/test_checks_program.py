# SPDX-License-Identifier: MIT
import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.deploy.station.installer import checks
from segway_ecc.deploy.station.installer.checks import check_environment, command_for, first_closed, ros_variables
from segway_ecc.deploy.station.installer.machine import TargetMachine
from segway_ecc.deploy.station.installer.settings import RELEASE
from segway_ecc.node.errors import ConfigurationError, RosUnavailableError
from tests.deploy.station.installer.conftest import COMMAND, Fake


def put(root: Path, name: str) -> str:
    (root / name[1:]).parent.mkdir(parents=True, exist_ok=True)
    (root / name[1:]).write_text("")
    return name


def test_the_program_is_that_of_this_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path, "/venv/bin/segway-ecc")
    # The one beside the interpreter, whose own link is not followed: it would lead out of the environment.
    monkeypatch.setattr(sys, "executable", str(tmp_path / "venv/bin/python"))
    machine = TargetMachine(Path("/"))
    assert command_for(machine, None) == str(tmp_path / "venv/bin/segway-ecc")
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "venv/bin/segway-ecc")])
    assert command_for(machine, None) == str(tmp_path / "venv/bin/segway-ecc")
    monkeypatch.setattr(sys, "argv", ["/x/main.py"])
    with pytest.raises(ConfigurationError, match="--command /nowhere/segway-ecc: there is no such program"):
        command_for(machine, None)


def test_of_a_release_the_link_that_outlives_it_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/opt/segway-ecc/releases/0.1.0-3f9a12bc/venv/bin/python")
    monkeypatch.setattr(sys, "argv", ["/opt/segway-ecc/releases/0.1.0-3f9a12bc/venv/bin/segway-ecc"])
    assert command_for(TargetMachine(Path("/")), None) == RELEASE


def test_in_a_root_file_system_it_is_the_release_or_what_is_installed_there(tmp_path: Path) -> None:
    machine = TargetMachine(tmp_path, is_live=False)
    with pytest.raises(ConfigurationError, match="there is no segway-ecc in --root"):
        command_for(machine, None)
    assert command_for(machine, put(tmp_path, "/opt/mine/segway-ecc")) == "/opt/mine/segway-ecc"
    put(tmp_path, "/usr/bin/segway-ecc")
    assert command_for(machine, None) == "/usr/bin/segway-ecc"
    (tmp_path / "opt/segway-ecc").mkdir(parents=True)
    (tmp_path / "opt/segway-ecc/current").symlink_to("/opt/segway-ecc/releases/1")
    assert command_for(machine, None) == RELEASE


@pytest.mark.parametrize("name", ["/opt/my venv/segway-ecc", "bin/segway-ecc", "/opt/%h/segway-ecc", "/a$b"])
def test_a_path_that_cannot_stand_in_a_unit_is_refused(fake: Fake, name: str) -> None:
    with pytest.raises(ConfigurationError, match="needs an absolute path"):
        command_for(fake.machine, name)


def test_a_program_that_is_chosen_has_to_be_there(fake: Fake) -> None:
    assert command_for(fake.machine, COMMAND) == COMMAND
    with pytest.raises(ConfigurationError, match="--command /opt/none: there is no such program"):
        command_for(fake.machine, "/opt/none")


def test_what_the_service_s_user_does_not_get_to_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "_HIDDEN", (tmp_path / "hidden",))
    for folder in (*tmp_path.parents, tmp_path):
        if folder.stat().st_uid == os.geteuid() and folder != Path("/"):
            folder.chmod(folder.stat().st_mode | 0o011)
    for name in ("hidden/x", "open/x", "closed/x", "open/secret"):
        put(tmp_path, f"/{name}")
    (tmp_path / "open/x").chmod(0o644)
    (tmp_path / "open/secret").chmod(0o640)
    (tmp_path / "open").chmod(0o755)
    (tmp_path / "closed").chmod(0o750)
    (tmp_path / "open/link").symlink_to("../hidden/x")
    assert first_closed([tmp_path / "open/x"]) is None
    assert first_closed([tmp_path / "open/x", tmp_path / "closed/x"]) == tmp_path / "closed"
    assert first_closed([tmp_path / "open/secret"]) == tmp_path / "open/secret"
    assert first_closed([tmp_path / "hidden/x"]) == tmp_path / "hidden/x"
    # As a virtual environment leads to the Python that made it.
    assert first_closed([tmp_path / "open/link"]) == tmp_path / "hidden/x"


@pytest.mark.parametrize("folder", ["/root/venv", "/home/ann/venv", "/run/user/1000/venv"])
def test_what_the_sandbox_hides_is_known(folder: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "require_station", lambda: None)
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda _name: importlib.machinery.ModuleSpec("x", None, origin="/usr")
    )
    with pytest.raises(ConfigurationError, match=f"{folder}/bin/segway-ecc is not visible to the service: make the"):
        check_environment(f"{folder}/bin/segway-ecc")


def test_missing_aiohttp_or_ros_raises_with_install_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("segway_ecc.node.ros.runtime.missing_packages", lambda: ["rclpy"])
    with pytest.raises(RosUnavailableError, match="rclpy"):
        check_environment(COMMAND)
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "aiohttp" else find(name))
    with pytest.raises(ConfigurationError, match=r"pip install 'segway-ecc\[station\]'"):
        check_environment(COMMAND)


def test_a_ros_that_was_sourced_is_handed_to_the_service() -> None:
    sourced = {"AMENT_PREFIX_PATH": "/opt/ros/jazzy", "PYTHONPATH": "/opt/ros/jazzy/lib/python3.12/site-packages"}
    assert ros_variables({**sourced, "HOME": "/root", "LD_LIBRARY_PATH": ""}) == sourced
    assert ros_variables({"PYTHONPATH": "/mine"}) == {}
    with pytest.raises(ConfigurationError, match="PYTHONPATH='/a b' cannot be passed"):
        ros_variables({**sourced, "PYTHONPATH": "/a b"})


def test_importing_the_verb_needs_no_aiohttp() -> None:
    code: Any = "import sys; sys.modules['aiohttp'] = None; import segway_ecc.deploy.verbs.station_install"
    subprocess.run([sys.executable, "-c", code], check=True)
