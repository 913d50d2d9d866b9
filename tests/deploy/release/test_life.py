# SPDX-License-Identifier: MIT
"""The life of a robot's software over a real ssh connection, by the command line, with the real pip."""

import ensurepip
import json
import shutil
import sysconfig
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.deploy.release.agent.main import probe
from segway_ecc.deploy.release.wheels import target_from
from segway_ecc.node.cli.main import main
from tests.deploy.release.parts import make_wheel
from tests.deploy.release.robot import Robot, Sshd


class Operator:
    """Types commands, and reads what they print."""

    def __init__(self, robot: Robot, sshd: Sshd, capsys: pytest.CaptureFixture[str]) -> None:
        self.robot, self._sshd, self._capsys = robot, sshd, capsys
        self.output = ""
        self.found: dict[str, Any] = {}

    def types(self, task: str, *words: str) -> int:
        where = ["--ssh-config", str(self._sshd.config), "--root", str(self.robot.root)]
        rules = [] if task == "status" else ["--trial", "0.1", "--start", "0.3", "--keep", "2"]
        config = ["--config", str(self.robot.config)]
        code = main(["deploy", task, "robot", *where, *config, *rules, "--json", *words])
        captured = self._capsys.readouterr()
        self.output, self.found = captured.err, json.loads(captured.out or "{}")
        return code

    def pushes(self, version: str, *words: str) -> int:
        return self.types("push", "--ros", "none", "--wheel", str(make_wheel(self.robot.folder, version)), *words)

    def version(self) -> str:
        return (self.robot.store.current() or "").partition("-")[0]


@pytest.fixture
def operator(
    module_robot: Robot, sshd: Sshd, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Operator:
    """On a machine that has pushed before: it has the real pip for robots of this kind, and needs no index."""
    cache = module_robot.folder / "cache"
    wheels = cache / "segway-ecc" / "wheels" / target_from(probe(module_robot.store, module_robot.config)).key
    wheels.mkdir(parents=True)
    # A distribution may keep what comes with Python in a folder of its own.
    bundled = sysconfig.get_config_var("WHEEL_PKG_DIR") or Path(ensurepip.__file__).parent / "_bundled"
    for wheel in Path(bundled).glob("pip-*.whl"):
        shutil.copy(wheel, wheels)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    for name in ("PIP_FIND_LINKS", "PIP_EXTRA_INDEX_URL"):
        monkeypatch.delenv(name, raising=False)
    return Operator(module_robot, sshd, capsys)


def test_push_status_a_broken_version_and_back_by_itself_and_by_hand(operator: Operator) -> None:
    robot = operator.robot
    (robot.config / "robot.yaml").unlink()
    assert operator.pushes("1.0") == 2, "there is no robot file to run with"
    assert operator.pushes("1.0", "--robot", "cart") == 0, operator.output
    assert operator.version() == "1.0"
    assert "model:" in (robot.config / "robot.yaml").read_text()
    robot.check_works()
    assert operator.pushes("2.0") == 0
    assert operator.version() == "2.0"
    assert "model:" in (robot.config / "robot.yaml").read_text(), "the robot file in use goes on"
    robot.check_works()

    assert operator.pushes("3.0+bad") == 12
    assert "the robot is in FAULT: told so; the robot went back to 2.0-" in operator.output
    assert (operator.version(), operator.found["outcome"]) == ("2.0", "went-back")
    robot.check_works()

    assert operator.types("status", "--verify") == 0
    states = {release["version"]: release["state"] for release in operator.found["releases"]}
    assert states == {"1.0": "healthy", "2.0": "healthy", "3.0+bad": "failed"}
    assert {release["changed"] for release in operator.found["releases"]} == {""}
    assert operator.found["last"]["outcome"] == "went-back"
    assert operator.found["rollback_to"].startswith("1.0-")

    assert operator.types("rollback") == 0
    assert operator.version() == "1.0"
    robot.check_works()
    assert operator.types("rollback") == 11, "nothing older is healthy"
    assert "--to" in operator.output
    assert operator.types("rollback", "--to", robot.store.complete()[1].name) == 0
    assert operator.version() == "2.0"
