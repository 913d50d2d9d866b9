# SPDX-License-Identifier: MIT
"""The model's parameters and opened variables, as anybody's ROS tools see and set them."""

import subprocess
from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.ros

Ask = Callable[..., Any]
Start = Callable[..., "subprocess.Popen[str]"]
TRIES = 2000
ROBOT = """
name: opened
model:
  source: segway_ecc.node.models.cart:Cart
  parameters: {Friction: 0.002}
arming: at_start
wiring:
  LinearSetpoint: set.speed
  LeftCurrent: topic.left.current
  Track: topic.track
  LeftSpeed: topic.left.speed
"""


@pytest.fixture(scope="module", autouse=True)
def robot(start: Start, foreign: Ask, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("robot") / "opened.yaml"
    path.write_text(ROBOT, "utf-8")
    start("opened", "run", str(path), "--ros", "--no-log")
    assert foreign("wait_for", node="model", namespace="/")


def test_a_parameter_has_its_unit_and_when_a_write_takes_effect_in_its_descriptor(foreign: Ask) -> None:
    text, read_only = foreign("describe_parameter", node="/model", name="Resistance")
    assert text == "Resistance, Ohm; a write takes effect at the next step, through the static equations"
    assert not read_only


def test_a_parameter_starts_with_the_value_of_the_robot_file(foreign: Ask) -> None:
    assert foreign("get_parameter", node="/model", name="Friction") == 0.002


def test_a_parameter_that_is_set_is_the_models_from_then_on(foreign: Ask) -> None:
    assert foreign("set_parameter", node="/model", name="Track", value=0.45) == [True, ""]
    assert any(foreign("receive", topic="/track")[-1] == 0.45 for _ in range(TRIES))
    assert foreign("get_parameter", node="/model", name="Track") == 0.45


def test_a_parameter_that_cannot_be_so_is_refused_with_the_reason_and_keeps_its_value(foreign: Ask) -> None:
    before = foreign("get_parameter", node="/model", name="Inertia")
    accepted, reason = foreign("set_parameter", node="/model", name="Inertia", value=float("inf"))
    assert not accepted
    assert reason == "'Inertia' cannot be inf: only finite values are taken"
    assert foreign("get_parameter", node="/model", name="Inertia") == before


def test_a_parameter_with_which_the_static_equations_fail_is_refused_and_the_robot_goes_on(foreign: Ask) -> None:
    accepted, reason = foreign("set_parameter", node="/model", name="WheelRadius", value=0.0)
    assert not accepted
    assert reason.startswith("'WheelRadius' cannot be 0.0: ZeroDivisionError")
    assert foreign("set_parameter", node="/model", name="Track", value=0.45) == [True, ""]


def test_a_value_that_is_set_drives_the_state_it_is_wired_to(foreign: Ask) -> None:
    assert foreign("publish_number", topic="/set/speed", value=2.0)
    # 2 m/s on wheels of 0.05 m are 40 rad/s; in steady state friction alone takes torque: b w / K = 0.8 A.
    settled = any(
        abs(foreign("receive", topic="/left/speed")[-1] - 40.0) < 2.0
        and abs(foreign("receive", topic="/left/current")[-1] - 0.8) < 0.1
        for _ in range(TRIES)
    )
    assert settled
    assert foreign("publish_number", topic="/set/speed", value=float("nan"))
    assert foreign("publish_number", topic="/set/speed", value=0.0)
    assert any(abs(foreign("receive", topic="/left/speed")[-1]) < 0.1 for _ in range(TRIES))
