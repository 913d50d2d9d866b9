# SPDX-License-Identifier: MIT
"""Transforms, description and joints of a robot, as RViz and its like take them; the URDF by check_urdf."""

import importlib.util
import os
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.node.config import decode_robot, load_robot, packaged_robots, read_text
from segway_ecc.node.robot import build_robot
from segway_ecc.node.ros.description import urdf
from tests.ros_messages import build_tf2_msgs
from tests.ros_processes import Ask, Start, receive_until

pytestmark = [pytest.mark.ros, pytest.mark.compiler]

CHECK = ("check_urdf",)
WHEELED = [name for name in packaged_robots() if name not in ("arm", "pan-tilt")]


@pytest.fixture(scope="module")
def ros_environment(ros_environment: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """That of these tests, with `tf2_msgs`."""
    if importlib.util.find_spec("tf2_msgs") is not None:
        return ros_environment
    folders = [str(build_tf2_msgs(tmp_path_factory.mktemp("tf2_msgs"))), os.environ.get("PYTHONPATH", "")]
    return {**ros_environment, "PYTHONPATH": os.pathsep.join(filter(None, folders))}


def parsed(text: str) -> ET.Element:
    return ET.fromstring(text)  # noqa: S314 - our own


def description(robot: str) -> str:
    built = build_robot(load_robot(robot), RealClock())
    return urdf(built.file, built.wiring.published)


@pytest.mark.urdf
@pytest.mark.parametrize("robot", WHEELED)
def test_the_description_of_a_packaged_robot_is_valid(robot: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(description(robot), "utf-8")
    found = subprocess.run([*CHECK, str(path)], check=True, capture_output=True, text=True)
    assert f"robot name is: {robot}" in found.stdout
    assert "root Link: base_link" in found.stdout


@pytest.mark.parametrize("robot", WHEELED)
def test_the_description_has_the_joints_that_are_published(robot: str) -> None:
    root = parsed(description(robot))
    wheels = [joint.get("name") for joint in root.iter("joint") if joint.get("type") == "continuous"]
    if robot == "skid-steer":
        assert sorted(map(str, wheels)) == [f"{a}_{b}_joint" for a in ("front", "rear") for b in ("left", "right")]
    else:
        assert wheels == ["left_wheel_joint", "right_wheel_joint"]


def test_the_description_has_the_lengths_of_the_file() -> None:
    root = parsed(description("segway"))
    joints = {joint.get("name"): joint for joint in root.iter("joint")}
    places = {name: str(joint.find("origin").get("xyz")) for name, joint in joints.items()}  # type: ignore[union-attr]
    assert places == {
        "left_wheel_joint": "0 0.1524 0.05",
        "right_wheel_joint": "0 -0.1524 0.05",
        "imu_joint": "0 0 0.557",
    }


@pytest.mark.parametrize("robot", ["arm", "pan-tilt"])
def test_a_robot_without_wheels_has_no_description(robot: str) -> None:
    assert description(robot) == ""


def test_names_that_xml_would_take_for_its_own_are_escaped() -> None:
    text = read_text("cart").replace("name: cart\n", 'name: a<b>&"c"\n')
    built = build_robot(decode_robot(text, "cart"), RealClock())
    assert parsed(urdf(built.file, built.wiring.published)).get("name") == 'a<b>&"c"'


@pytest.fixture(scope="module")
def robots(start_for_all: Start, foreign: Ask, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A cart whose frames begin with its namespace, and one that measures torques."""
    path = tmp_path_factory.mktemp("robot") / "prefixed.yaml"
    text = read_text("cart").replace("ros: {odometry_depth: 1000}", "ros: {prefix_frames: true}")
    path.write_text(text, "utf-8")
    start_for_all("prefixed", "lock-step", str(path), "--namespace", "/robot1")
    start_for_all("torques", "lock-step", "cart-odrive", "--namespace", "/robot2")
    for namespace in ("/robot1", "/robot2"):
        assert foreign("wait_for", node="model", namespace=namespace)


@pytest.mark.usefixtures("robots")
def test_the_transform_is_the_odometry_in_frames_of_the_namespace(foreign: Ask) -> None:
    foreign("listen", topic="/tf")
    for _ in range(5):
        assert foreign("publish", topic="/robot1/cmd_vel", kind="Twist", linear=0.5, angular=0.5)
    moving = receive_until(foreign, "/robot1/odom", lambda odom: odom["linear"] > 0.1)
    (transform,) = receive_until(
        foreign,
        "/tf",
        lambda found: found[0]["stamp_ns"] == moving["stamp_ns"] and found[0]["frames"][0] == "robot1/odom",
    )
    assert transform == {key: moving[key] for key in ("stamp_ns", "frames", "x", "y", "z", "w")}
    assert transform["frames"] == ["robot1/odom", "robot1/base_link"]


@pytest.mark.usefixtures("robots")
def test_the_description_is_there_for_whoever_comes_later(foreign: Ask) -> None:
    assert foreign("latched", topic="/robot1/robot_description") == [description("cart")]
    assert foreign("latched", topic="/robot2/robot_description") == [description("cart-odrive")]


@pytest.mark.usefixtures("robots")
def test_joint_states_have_the_effort_that_drives_measure(foreign: Ask) -> None:
    for _ in range(5):
        assert foreign("publish", topic="/robot2/cmd_vel", kind="Twist", linear=0.5, angular=0.0)
    joints = receive_until(foreign, "/robot2/joint_states", lambda found: any(found["effort"]))
    assert len(joints["effort"]) == len(joints["name"]) == 2
    assert foreign("receive", topic="/robot1/joint_states")[-1]["effort"] == [], "a model of a cart measures none"


def test_no_transform_is_published_where_a_filter_is_to_publish_it(start: Start, foreign: Ask, tmp_path: Path) -> None:
    path = tmp_path / "filtered.yaml"
    text = read_text("cart").replace("ros: {odometry_depth: 1000}", "ros: {odometry_tf: false}")
    path.write_text(text, "utf-8")
    start("filtered", "lock-step", str(path), "--namespace", "/robot3")
    assert foreign("wait_for", node="model", namespace="/robot3")
    assert foreign("receive", topic="/robot3/odom")
    topics = foreign("topics_of", node="model", namespace="/robot3")
    assert "/tf" not in topics
    assert "/robot3/odom" in topics
