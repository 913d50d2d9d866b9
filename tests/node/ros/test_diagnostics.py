# SPDX-License-Identifier: MIT
"""Diagnostics and rosout of a robot in a namespace, as rqt and Foxglove take them."""

from typing import Any

import pytest

from tests.ros_processes import Ask, Start, receive_until

pytestmark = pytest.mark.ros

INFO, WARN, ERROR = 20, 30, 40


@pytest.fixture(scope="module", autouse=True)
def robots(start_for_all: Start, foreign: Ask) -> None:
    """One in a namespace, and one without."""
    start_for_all("robot1", "run", "cart", "--ros", "--no-log", "--namespace", "/robot1")
    start_for_all("robot", "run", "cart", "--ros", "--no-log")
    for namespace in ("/", "/robot1"):
        assert foreign("wait_for", node="model", namespace=namespace)
    foreign("listen", topic="/rosout")
    # The robot looks ten times a second who subscribes.
    receive_until(foreign, "/rosout", lambda line: line["name"] == "robot1.model")


def logged(foreign: Ask, start: str) -> dict[str, Any]:
    """The line of the robot in the namespace that begins so."""
    found: dict[str, Any] = receive_until(
        foreign, "/rosout", lambda line: line["name"] == "robot1.model" and line["text"].startswith(start)
    )
    return found


def test_all_diagnostics_are_on_one_topic_with_the_names_of_their_robots(foreign: Ask) -> None:
    parts = ("mode", "timing", "set-points", "hardware", "ros")
    found = receive_until(foreign, "/diagnostics", lambda all_: "robot1/cart: mode" in all_)
    assert list(found) == [f"robot1/cart: {part}" for part in parts]
    assert {status["hardware_id"] for status in found.values()} == {"robot1/cart"}
    found = receive_until(foreign, "/diagnostics", lambda all_: "cart: mode" in all_)
    assert {status["hardware_id"] for status in found.values()} == {"cart"}
    found = foreign("receive", topic="/robot1/diagnostics")[-1]
    assert list(found) == [f"cart: {part}" for part in parts]
    assert {status["hardware_id"] for status in found.values()} == {"cart"}


def test_mode_changes_and_refused_requests_are_logged(foreign: Ask) -> None:
    assert foreign("call", service="/robot1/model/stop")[0]
    assert logged(foreign, "FAULT: ") == {"level": ERROR, "name": "robot1.model", "text": "FAULT: stop was pressed"}
    assert not foreign("call", service="/robot1/model/arm")[0]
    refused = logged(foreign, "arm is refused: ")
    assert (refused["level"], refused["text"]) == (WARN, "arm is refused: clear the fault first: stop was pressed")
    assert foreign("call", service="/robot1/model/clear_fault")[0]
    assert logged(foreign, "DISARMED: ")["level"] == INFO


def test_refused_set_points_are_logged_with_their_causes(foreign: Ask) -> None:
    foreign("call", service="/robot1/model/disarm")
    assert foreign("publish", topic="/robot1/cmd_vel", kind="Twist", linear=0.1, angular=0.0)
    line = logged(foreign, "set-points: 1 refused since the last report")
    assert line["level"] == WARN
    assert "refused.not_armed" in line["text"]


def test_publishers_that_never_reach_the_robot_are_logged(foreign: Ask) -> None:
    assert foreign("advertise", topic="/robot1/cmd_vel_stamped", kind="String", best_effort=False)
    line = logged(foreign, "/foreign publishes std_msgs/msg/String on /robot1/cmd_vel_stamped, which takes ")
    assert line["level"] == WARN


def test_subscribers_that_receive_nothing_are_logged(foreign: Ask, messages: Any) -> None:
    assert foreign("subscribe_transient_local", topic="/robot1/mode")
    text = (
        "/foreign subscribes to /robot1/mode as transient local, and we publish volatile: it receives nothing. "
        "Set its durability to volatile"
    )
    assert logged(foreign, text)["level"] == WARN
    assert f"segway-ecc: {text}" in (messages / "robot1.txt").read_text().splitlines()
