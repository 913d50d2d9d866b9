# SPDX-License-Identifier: MIT
"""Parameters that a robot is started with, dumped and loaded, as `ros2 param` does it."""

from pathlib import Path
from typing import Any

import pytest

from tests.ros_processes import Ask, Start

pytestmark = pytest.mark.ros

GIVEN = """
/model:
  ros__parameters:
    WheelRadius: 0.0625
    Track: 0.31
"""


@pytest.fixture(scope="module")
def robot(start_for_all: Start, foreign: Ask, on_request: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A robot that is disarmed, with parameters of a file."""
    path = tmp_path_factory.mktemp("parameters") / "given.yaml"
    path.write_text(GIVEN, "utf-8")
    start_for_all("given", "run", on_request, "--ros", "--no-log", "--ros-args", "--params-file", str(path))
    assert foreign("wait_for", node="model", namespace="/")


@pytest.mark.usefixtures("robot")
def test_parameters_of_a_file_are_those_that_the_model_runs_with(foreign: Ask) -> None:
    values = {name: foreign("get_parameter", node="/model", name=name) for name in ("WheelRadius", "Track")}
    assert values == {"WheelRadius": 0.0625, "Track": 0.31}
    # The model drives with the radius: 0.5 m/s are 8 rad/s of a wheel of 0.0625 m, and 10 of one of 0.05 m.
    assert foreign("call", service="/model/arm")[0]
    for _ in range(2000):
        assert foreign("publish", topic="/cmd_vel", kind="Twist", linear=0.5, angular=0.0)
        odom, joints = (foreign("receive", topic=topic) for topic in ("/odom", "/joint_states"))
        by_stamp = {each["stamp_ns"]: each["velocity"] for each in joints}
        both = [(each["linear"], by_stamp[each["stamp_ns"]]) for each in odom if each["stamp_ns"] in by_stamp]
        if both and both[-1][0] > 0.49:
            break
    linear, velocity = both[-1]
    assert 0.0625 * sum(velocity) / 2 == pytest.approx(linear)
    assert foreign("call", service="/model/disarm")[0]


@pytest.mark.usefixtures("robot")
def test_what_is_dumped_is_loaded_into_the_robot_again(foreign: Ask, tmp_path: Path) -> None:
    dump = tmp_path / "dump.yaml"
    before: dict[str, Any] = foreign("dump_parameters", node="/model", path=str(dump))
    assert (before["WheelRadius"], before["Track"]) == (0.0625, 0.31)
    assert foreign("set_parameter", node="/model", name="Track", value=0.35) == [True, ""]
    assert foreign("load_parameters", node="/model", path=str(dump)) == []
    assert foreign("dump_parameters", node="/model", path=str(dump)) == before


@pytest.mark.usefixtures("robot")
def test_what_is_dumped_starts_another_robot(foreign: Ask, start: Start, on_request: str, tmp_path: Path) -> None:
    dump = tmp_path / "dump.yaml"
    before = foreign("dump_parameters", node="/model", path=str(dump))
    dump.write_text(dump.read_text("utf-8").replace("/model:", "/second/model:"), "utf-8")
    words = ["run", on_request, "--ros", "--no-log", "--namespace", "/second", "--ros-args", "--params-file", str(dump)]
    start("second", *words)
    assert foreign("wait_for", node="model", namespace="/second")
    assert foreign("dump_parameters", node="/second/model", path=str(dump)) == before


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ("Track:=1", "'Track' takes a floating-point number: write it with a point, such as 1.0"),
        ("Track:=wide", "'Track' takes a floating-point number: write it with a point, such as 1.0"),
        ("Track:=9.0", "'Track' cannot be 9.0: allowed is 0.2 to 0.6 m"),
    ],
)
def test_a_parameter_that_is_refused_ends_the_start_with_one_line(
    start: Start, messages: Path, given: str, line: str
) -> None:
    words = ["run", "cart", "--ros", "--no-log", "--duration", "9", "--ros-args", "-p", given]
    assert start("refused", *words).wait() == 2
    assert (messages / "refused.txt").read_text().splitlines() == [f"segway-ecc: parameter override: {line}"]
