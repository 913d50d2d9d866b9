# SPDX-License-Identifier: MIT
"""The robot file, and the models that stand beside it."""

from pathlib import Path

import pytest

from segway_ecc.deploy.release.requests import robot_files
from segway_ecc.node.config import load_robot
from segway_ecc.node.errors import ConfigurationError

ROBOT = "name: r\nmodel: {{source: '{}'}}\nwiring: {{}}\n"


def found(folder: Path, source: str) -> set[str]:
    path = folder / "my robot.yaml"
    path.write_text(ROBOT.format(source))
    return set(robot_files(path, load_robot(str(path))))


def test_a_model_of_the_package_needs_no_file(tmp_path: Path) -> None:
    assert found(tmp_path, "segway_ecc.node.models.cart:Cart") == {"robot/robot.yaml"}


@pytest.mark.parametrize(
    ("source", "files", "taken"),
    [
        ("own:Model", ["own.py", "other.py"], {"robot/own.py"}),
        (
            "own.deep:Model",
            ["own/__init__.py", "own/deep.py", "own/__pycache__/x.pyc"],
            {"robot/own/__init__.py", "robot/own/deep.py"},
        ),
        ("code", ["code/xxmodel.c", "code/xxmodel.h"], {"robot/code/xxmodel.c", "robot/code/xxmodel.h"}),
        ("m.fmu", ["m.fmu"], {"robot/m.fmu"}),
    ],
)
def test_what_stands_beside_it_goes_along(tmp_path: Path, source: str, files: list[str], taken: set[str]) -> None:
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
    assert found(tmp_path, source) == {"robot/robot.yaml", *taken}


def test_nothing_above_the_folder_is_taken(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (tmp_path / "secret").write_text("x")
    with pytest.raises(ConfigurationError, match="does not lie beside the robot file and cannot be sent along"):
        found(folder, "../secret")


def test_a_name_that_the_robot_does_not_take_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a b").mkdir()
    (tmp_path / "a b" / "x.c").write_text("x")
    with pytest.raises(ConfigurationError, match="rename it"):
        found(tmp_path, "a b")


def test_a_model_from_the_current_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "own.py").write_text("x")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        ConfigurationError, match=rf"^{tmp_path}/own.py does not lie beside .*: move it into .*/robots$"
    ):
        found(tmp_path / "robots", "own:Model")


def test_a_path_that_the_robot_does_not_have_is_refused(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text("x")
    with pytest.raises(
        ConfigurationError, match="own:Model is not there on the robot: write it from the file's folder"
    ):
        found(tmp_path, f"{tmp_path}/own:Model")


def test_a_model_in_a_folder_beside_it_goes_along_with_the_plant(tmp_path: Path) -> None:
    for name in ("deep/own.py", "pool.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("x")
    path = tmp_path / "my robot.yaml"
    path.write_text(ROBOT.format("deep/own:Model") + "simulation: {plant: 'pool:Pool'}\n")

    assert set(robot_files(path, load_robot(str(path)))) == {"robot/robot.yaml", "robot/deep/own.py", "robot/pool.py"}
