# SPDX-License-Identifier: MIT
"""Two robots of one name in one domain: the second notices, and how to name it is logged."""

from pathlib import Path
from typing import Any

import pytest

from tests.ros_processes import Ask, Start, receive_until

pytestmark = pytest.mark.ros

TEXT = (
    "another /model is in this ROS domain, and topics, services and commands of the two are mixed up (a run that died "
    "is still seen for 20 s): name each robot with --namespace /NAME, or give it another ROS_DOMAIN_ID"
)


def test_a_second_robot_of_the_same_name_is_noticed_by_both(start: Start, foreign: Ask, messages: Path) -> None:
    start("first", "run", "cart", "--ros", "--no-log")
    assert foreign("wait_for", node="model", namespace="/")
    start("second", "run", "cart", "--ros", "--no-log")

    def are_noticed(_odometry: Any) -> bool:
        lines = [(messages / f"{name}.txt").read_text().splitlines() for name in ("first", "second")]
        return all(f"segway-ecc: {TEXT}" in each for each in lines)

    receive_until(foreign, "/odom", are_noticed)


def test_robots_in_namespaces_of_their_own_are_none(start: Start, foreign: Ask, messages: Path) -> None:
    for name in ("a", "b"):
        start(name, "run", "cart", "--ros", "--no-log", "--namespace", f"/{name}")
    for name in ("a", "b"):
        assert foreign("wait_for", node="model", namespace=f"/{name}")
    for _ in range(3):  # once a second, and they are looked for twice a second
        foreign("receive", topic="/b/diagnostics")
    assert not any("another" in (messages / f"{name}.txt").read_text() for name in ("a", "b"))
