# SPDX-License-Identifier: MIT
"""Generated code named on the command line and in a robot file."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import segway_ecc.node.models

Run = Callable[..., Any]
CART = Path(segway_ecc.node.models.__file__).with_name("cart_submodel")
pytestmark = pytest.mark.compiler


def test_a_folder_is_inspected_like_any_model(segway_ecc: Run) -> None:
    found = json.loads(segway_ecc("model", "inspect", str(CART), "--json").out)
    assert (found["flavour"], found["method"], found["step_size_s"]) == ("20-sim C submodel", "RungeKutta4", 0.01)
    assert [v["name"] for v in found["outputs"]][:3] == ["X", "Y", "Heading"]
    track = next(v for v in found["parameters"] if v["name"] == r"Body\Track")
    assert (track["unit"], track["value"], track["write"]) == ("m", 0.3, "static")
    assert track["why"]


def test_a_folder_is_simulated_with_a_parameter_of_its_own(segway_ecc: Run) -> None:
    words = ("model", "simulate", str(CART), "--duration", "0.5", "--json")
    assert json.loads(segway_ecc(*words).out)["outputs"]["X"] == 0.0
    outcome = segway_ecc(*words, "--set", r"Body\Trak=1")
    assert outcome.code == 3
    assert r"no parameter of model 'Cart' is called 'Body\Trak'; there is Body\Resistance, " in outcome.errors[0]


def test_a_robot_file_finds_a_folder_that_stands_beside_it(segway_ecc: Run, tmp_path: Path) -> None:
    shutil.copytree(CART, tmp_path / "my cart")
    (tmp_path / "drive.yaml").write_text("segments: [{linear: 1.0, duration: 0.3}]", "utf-8")
    (tmp_path / "robot.yaml").write_text(
        "name: generated\nmodel: {source: my cart}\narming: at_start\nwiring:\n"
        "  'Setpoints\\LinearSetpoint': setpoint.linear_velocity\n  X: odometry.x\n  Y: odometry.y\n"
        "  Heading: odometry.heading\n  LinearVelocity: odometry.linear_velocity\n"
        "  AngularVelocity: odometry.angular_velocity\n",
        "utf-8",
    )
    words = ("run", str(tmp_path / "robot.yaml"), "--no-ros", "--no-log", "--json")
    outcome = segway_ecc(*words, "--sequence", str(tmp_path / "drive.yaml"))
    assert outcome.code == 0
    assert json.loads(outcome.out)["stop_reason"] == "the sequence is over"


def test_a_path_that_is_not_there_is_told(segway_ecc: Run, tmp_path: Path) -> None:
    outcome = segway_ecc("model", "inspect", str(tmp_path / "gone"))
    assert outcome.code == 3
    (line,) = outcome.errors
    assert line.startswith(f"segway-ecc: there is no folder {tmp_path / 'gone'}: ")
