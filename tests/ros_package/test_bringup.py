# SPDX-License-Identifier: MIT
"""The ament package: what colcon makes of the checkout, and that its files say what is there."""

import argparse
import importlib
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import yaml

from segway_ecc.node.cli.main import find_verbs
from segway_ecc.node.config import load_robot
from segway_ecc.node.models.load import load_model
from tests.ros_processes import Ask, Start

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "ros" / "segway_ecc_bringup"
LAUNCH = sorted((PACKAGE / "launch").glob("*.launch.xml"))
PROGRAM = "segway-ecc"


def parsed(path: Path) -> ET.Element:
    return ET.fromstring(path.read_text("utf-8"))  # noqa: S314 - our own


def commands(path: Path, **arguments: str) -> list[list[str]]:
    """The command lines of a launch file, with its arguments as they are given or by default."""
    root = parsed(path)
    values = {each.get("name", ""): each.get("default", "") for each in root.iter("arg")} | arguments
    found = []
    for executable in root.iter("executable"):
        text = re.sub(r"\$\(var (\w+)\)", lambda match: values[match[1]], executable.get("cmd", ""))
        found.append(text.split())
    return found


def options_of(words: list[str]) -> argparse.Namespace:
    """What our command line makes of a command; SystemExit where it takes it not."""
    assert words[0] == PROGRAM
    verbs = find_verbs()
    name = next(name for name in (" ".join(words[1:3]), words[1]) if name in verbs and verbs[name].package)
    rest = words[1 + len(name.split()) :]
    parser = argparse.ArgumentParser()
    importlib.import_module(verbs[name].module).add_arguments(parser)
    return parser.parse_args(rest[: rest.index("--ros-args")] if "--ros-args" in rest else rest)


@pytest.mark.parametrize("path", LAUNCH, ids=lambda path: path.name)
def test_a_launch_file_starts_what_our_command_line_takes(path: Path) -> None:
    (words,) = commands(path)
    assert options_of(words)


def test_a_robot_is_launched_by_its_file_in_a_namespace_with_a_log() -> None:
    arguments = {"robot": "robot.yaml", "namespace": "/robot1", "log": "--log run.mcap", "params": "-p Track:=0.31"}
    (words,) = commands(PACKAGE / "launch" / "robot.launch.xml", **arguments)
    options = options_of(words)
    assert (options.robot, options.namespace, str(options.log)) == ("robot.yaml", "/robot1", "run.mcap")
    assert words[-3:] == ["--ros-args", "-p", "Track:=0.31"]


def test_the_package_is_what_ros_expects() -> None:
    root = parsed(PACKAGE / "package.xml")
    assert root.findtext("name") == "segway_ecc_bringup"
    assert [each.text for each in root.iter("build_type")] == ["ament_python"]
    assert (PACKAGE / "resource" / "segway_ecc_bringup").exists()


@pytest.mark.colcon
def test_colcon_builds_the_checkout(tmp_path: Path) -> None:
    words = [sys.executable, "-c", "from colcon_core.command import main; raise SystemExit(main())", "build"]
    built = subprocess.run(
        [*words, "--base-paths", str(ROOT)], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    assert "Summary: 1 package finished" in built.stdout
    assert "ERROR" not in built.stderr
    share = tmp_path / "install" / "segway_ecc_bringup" / "share" / "segway_ecc_bringup"
    for folder in ("launch", "config", "layouts"):
        assert sorted(each.name for each in (share / folder).iterdir()) == sorted(
            each.name for each in (PACKAGE / folder).iterdir()
        )
    assert (share / "package.xml").exists()


def parameters(name: str) -> Any:
    return yaml.safe_load((PACKAGE / "config" / name).read_text("utf-8"))


def test_the_parameters_are_those_of_the_cart_within_their_ranges() -> None:
    given = parameters("params.yaml")["/model"]["ros__parameters"]
    file = load_robot("cart")
    names = {each.name for each in load_model(file.model.source).parameters}
    assert given.keys() <= names
    for name, value in given.items():
        low, high = file.model.ranges[name]
        assert low is not None
        assert high is not None
        assert type(value) is float
        assert low <= value <= high


@pytest.mark.ros
def test_the_launch_file_starts_a_robot_with_the_parameters(start: Start, foreign: Ask) -> None:
    arguments = {"log": "--no-log", "params": f"--params-file {PACKAGE / 'config' / 'params.yaml'}"}
    (words,) = commands(PACKAGE / "launch" / "robot.launch.xml", **arguments)
    start("launched", *words[1:])
    assert foreign("wait_for", node="model", namespace="/")
    assert foreign("get_parameter", node="/model", name="FeedbackGain") == 0.09


def test_layouts_are_what_their_programs_read() -> None:
    assert yaml.safe_load((PACKAGE / "layouts" / "robot.rviz").read_text("utf-8"))["Visualization Manager"]
    layout = json.loads((PACKAGE / "layouts" / "foxglove.json").read_text("utf-8"))
    assert layout["layout"]["first"]["first"] in layout["configById"]
    curves = [curve.get("name", "") for curve in parsed(PACKAGE / "layouts" / "plotjuggler.xml").iter("curve")]
    assert {curve.split("/")[1] for curve in curves} == {"odom", "setpoint"}


def test_the_filter_fuses_what_the_robot_publishes() -> None:
    ekf = parameters("ekf.yaml")["ekf_filter_node"]["ros__parameters"]
    ros = load_robot("segway").ros
    assert (ekf["odom_frame"], ekf["base_link_frame"]) == (ros.odometry_frame, ros.base_frame)
    assert (ekf["odom0"], ekf["imu0"]) == ("odom", "imu/data")
    assert len(ekf["odom0_config"]) == len(ekf["imu0_config"]) == 15


def test_navigation_asks_for_no_more_than_the_cart_takes() -> None:
    smoother = parameters("nav2.yaml")["velocity_smoother"]["ros__parameters"]
    setpoint = load_robot("cart").setpoint
    assert setpoint.max_linear_velocity is not None
    assert setpoint.max_angular_velocity is not None
    assert smoother["max_velocity"][0] <= setpoint.max_linear_velocity
    assert smoother["max_velocity"][2] <= setpoint.max_angular_velocity
    assert smoother["max_velocity"][1] == 0.0, "it has wheels"
    assert smoother["velocity_timeout"] == setpoint.timeout_s
