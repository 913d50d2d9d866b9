# SPDX-License-Identifier: MIT
"""A robot with an IMU as other people's ROS tools see it."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.node.config import decode_robot, read_text
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.robot import build_robot

pytestmark = pytest.mark.ros

Ask = Callable[..., Any]
Start = Callable[..., "subprocess.Popen[str]"]

MODEL = '''
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import SectionedModel


class Leaning(SectionedModel):
    """Stands still at an angle, and reports it."""

    name = "leaning"
    step_size = 0.01
    outputs = tuple(Variable(name) for name in ("RateX", "RateY", "RateZ", "ForceX", "ForceY", "ForceZ"))

    def output(self):
        return (0.25, -0.5, 0.75, 1.0, -2.0, 9.5)
'''
ROBOT = """
name: leaning
model: {source: "leaning_model:Leaning"}
arming: at_start
wiring:
  RateX: imu.angular_velocity_x
  RateY: imu.angular_velocity_y
  RateZ: imu.angular_velocity_z
  ForceX: imu.linear_acceleration_x
  ForceY: imu.linear_acceleration_y
  ForceZ: imu.linear_acceleration_z
"""


@pytest.fixture
def robot(start: Start, foreign: Ask, tmp_path: Path) -> None:
    (tmp_path / "leaning_model.py").write_text(MODEL, "utf-8")
    file = tmp_path / "leaning.yaml"
    file.write_text(ROBOT, "utf-8")
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    start("leaning", "run", str(file), "--ros", "--no-log", env={"PYTHONPATH": path})
    assert foreign("wait_for", node="model", namespace="/")


@pytest.mark.usefixtures("robot")
def test_an_imu_is_received_by_a_foreign_node(foreign: Ask) -> None:
    received = foreign("receive", topic="/imu/data")
    assert received, "nothing comes on /imu/data"
    covariances = [round(value, 9) for value in received[-1]["other_covariances"]]
    assert {**received[-1], "stamp_ns": 0, "other_covariances": covariances} == {
        "stamp_ns": 0,
        "frame": "imu_link",
        "angular_velocity": [0.25, -0.5, 0.75],
        "linear_acceleration": [1.0, -2.0, 9.5],
        "orientation_covariance": [-1.0] + [0.0] * 8,
        "orientation": [0.0, 0.0, 0.0, 1.0],
        "other_covariances": [1e-4, 0, 0, 0, 1e-4, 0, 0, 0, 1e-4, 0.04, 0, 0, 0, 0.04, 0, 0, 0, 0.04],
    }


def test_a_pitch_that_is_published_nowhere_is_refused() -> None:
    text = read_text("cart").replace("ros: {odometry_depth: 1000}", "ros: {pitch: lean}")
    with pytest.raises(ConfigurationError, match=r"^ros\.pitch: nothing is wired to topic\.lean$"):
        build_robot(decode_robot(text, "cart"), RealClock())
