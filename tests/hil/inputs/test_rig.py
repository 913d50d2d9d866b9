# SPDX-License-Identifier: MIT
"""The robot file that a trial runs."""

from pathlib import Path

import pytest

from segway_ecc.hil.errors import RigError
from segway_ecc.hil.inputs.rig import Arrangement, Misbehaviour, robot_text
from segway_ecc.hil.inputs.table import all_trials
from segway_ecc.node.config import load_robot, read_text

ROBOTS = ("segway", "segway-odrive")


@pytest.mark.parametrize("robot", ROBOTS)
def test_nothing_is_changed_where_nothing_is_to_be(tmp_path: Path, robot: str) -> None:
    assert robot_text(robot, Arrangement(), tmp_path) == read_text(robot)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_arrangement_is_a_robot_that_loads(tmp_path: Path, robot: str) -> None:
    for arrangement in {each.arrangement for each in all_trials()}:
        path = tmp_path / "robot.yaml"
        path.write_text(robot_text(robot, arrangement, tmp_path), "utf-8")
        file = load_robot(str(path))
        assert file.arming == ("on_request" if arrangement.on_request else "at_start")
        assert file.model.source.endswith("misbehaving:Misbehaving") is (arrangement.model is not None)


def test_a_model_that_misbehaves_is_python_of_the_packaged_one(tmp_path: Path) -> None:
    robot_text("segway", Arrangement(model=Misbehaviour("1 / 0", "print('x')", "pass")), tmp_path)
    text = (tmp_path / "misbehaving.py").read_text("utf-8")
    compile(text, "misbehaving.py", "exec")
    assert "SegwayVoltageController as Packaged" in text
    assert text.count("1 / 0") == 1


def test_a_change_of_what_does_not_stand_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="robot 'segway' has 'no such' 0 times, and not once"):
        robot_text("segway", Arrangement((("no such", "text"),)), tmp_path)
