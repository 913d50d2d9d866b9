# SPDX-License-Identifier: MIT
"""The model's parameters and opened variables, as anybody's ROS tools see and set them."""

import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.process_usage import helpers_of
from segway_ecc.node.cycle.interfaces import Written
from segway_ecc.node.replay.recorded import RecordedRun
from segway_ecc.node.replay.replay import replay
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.ros

Ask = Callable[..., Any]
Start = Callable[..., "subprocess.Popen[str]"]
TRIES = 2000
ROBOT = """
name: opened
model:
  source: segway_ecc.node.models.cart:Cart
  parameters: {Friction: 0.002}
  ranges: {Track: [0.3, 0.5]}
  tunable_while_armed: [Track]
arming: at_start
wiring:
  LinearSetpoint: set.speed
  LeftCurrent: topic.left.current
  Track: topic.track
  LeftSpeed: topic.left.speed
"""


@pytest.fixture(scope="module", autouse=True)
def robot(start_for_all: Start, foreign: Ask, tmp_path_factory: pytest.TempPathFactory) -> "subprocess.Popen[str]":
    path = tmp_path_factory.mktemp("robot") / "opened.yaml"
    path.write_text(ROBOT, "utf-8")
    words = ["run", str(path), "--ros", "--no-log", "--ros-args", "-p", "AssumedTrack:=0.31"]
    process = start_for_all("opened", *words)
    assert foreign("wait_for", node="model", namespace="/")
    return process


def test_a_parameter_has_its_unit_and_when_a_write_takes_effect_in_its_descriptor(foreign: Ask) -> None:
    text, read_only, *_ = foreign("describe_parameter", node="/model", name="Resistance")
    assert text == "Resistance, Ohm; a write takes effect at the next step, through the static equations"
    assert not read_only


def test_a_parameter_has_its_range_and_when_it_is_taken_in_its_descriptor(foreign: Ask) -> None:
    *_, bounds, when = foreign("describe_parameter", node="/model", name="Resistance")
    assert (bounds, when) == ([[0.001, 100.0]], "taken only while the robot is not armed")
    *_, bounds, when = foreign("describe_parameter", node="/model", name="Track")
    assert (bounds, when) == ([[0.3, 0.5]], "taken also while the robot is armed")


def test_a_parameter_starts_with_the_value_of_the_robot_file(foreign: Ask) -> None:
    assert foreign("get_parameter", node="/model", name="Friction") == 0.002


def test_an_override_at_the_start_is_the_parameters_value(foreign: Ask) -> None:
    assert foreign("get_parameter", node="/model", name="AssumedTrack") == 0.31


def test_a_run_with_an_override_is_replayed_with_it(start: Start, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    words = ["run", "cart", "--ros", "--namespace", "/other", "--duration", "1", "--log", str(log), "--ros-args"]
    assert start("overridden", *words, "-p", "WheelRadius:=0.0625").wait() == 0
    first = next(iter(RecordedRun(log).cycles()))
    assert first.inbox is not None
    assert first.inbox.written == [Written("WheelRadius", 0.0625)]
    outcome = replay(log)
    assert (outcome.cycles, outcome.difference) == (100, None)


def test_an_override_that_is_refused_ends_the_start_as_a_wrong_configuration(start: Start, messages: Path) -> None:
    words = ["run", "cart", "--ros", "--no-log", "--duration", "9", "--ros-args", "-p", "WheelRadius:=0.0"]
    assert start("refused", *words).wait() == 2
    (line,) = (messages / "refused.txt").read_text().splitlines()
    assert line == "segway-ecc: parameter override: 'WheelRadius' cannot be 0.0: allowed is 0.03 to 0.1 m"


def test_a_parameter_that_is_set_is_the_models_from_then_on(foreign: Ask) -> None:
    assert foreign("set_parameter", node="/model", name="Track", value=0.45) == [True, ""]
    assert any(foreign("receive", topic="/track")[-1] == 0.45 for _ in range(TRIES))
    assert foreign("get_parameter", node="/model", name="Track") == 0.45


@pytest.mark.parametrize("value", [float("inf"), 0.0, -0.05])
def test_a_parameter_beyond_its_range_is_refused_and_keeps_its_value(foreign: Ask, value: float) -> None:
    before = foreign("get_parameter", node="/model", name="WheelRadius")
    accepted, reason = foreign("set_parameter", node="/model", name="WheelRadius", value=value)
    assert not accepted
    assert reason == f"Parameter WheelRadius out of range Min: 0.005, Max: 1.0, value: {value}"
    assert foreign("get_parameter", node="/model", name="WheelRadius") == before


def test_a_parameter_that_is_not_tunable_while_armed_is_refused_and_blocks_no_other(foreign: Ask) -> None:
    accepted, reason = foreign("set_parameter", node="/model", name="WheelRadius", value=0.06)
    assert not accepted
    assert reason == "'WheelRadius' is not tunable while the robot is armed: disarm it first"
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


def test_parameters_are_as_they_were_in_a_ros_process_that_replaces_another(
    robot: "subprocess.Popen[str]", foreign: Ask, messages: Path
) -> None:
    assert foreign("set_parameter", node="/model", name="Track", value=0.35) == [True, ""]
    first = helpers_of(robot.pid)["ros"]
    os.kill(first, signal.SIGKILL)
    deadline_s = time.monotonic() + PATIENCE_S
    while "the robot is in ROS again" not in (messages / "opened.txt").read_text():
        assert time.monotonic() < deadline_s
        time.sleep(0.1)
    # Until then it is the dead one's services that are seen, which never answer.
    while foreign("call", service="/model/arm", within_s=3.0) is None:
        assert time.monotonic() < deadline_s
    values = [foreign("get_parameter", node="/model", name=name) for name in ("Track", "AssumedTrack", "Friction")]
    assert values == [0.35, 0.31, 0.002]
    assert foreign("set_parameter", node="/model", name="Track", value=0.45) == [True, ""]
    assert any(foreign("receive", topic="/track")[-1] == 0.45 for _ in range(TRIES))
