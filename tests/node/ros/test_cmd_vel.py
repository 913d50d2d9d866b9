# SPDX-License-Identifier: MIT
"""The settings of `cmd_vel`: its type, a stamp of zero, and what becomes of what asks for too much."""

from pathlib import Path
from typing import Any

import pytest

from segway_ecc.node.config import read_text
from tests.ros_processes import Ask, Start, receive_until

pytestmark = pytest.mark.ros

SETTINGS = {
    "ros: {odometry_depth: 1000}": "ros: {cmd_vel: TwistStamped}",
    "max_angular_velocity: 10.0}": "max_angular_velocity: 10.0, beyond_limits: clamp}",
    "max_linear_velocity: 10.0": "max_linear_velocity: 0.5",
}


@pytest.fixture(scope="module", autouse=True)
def robots(start_for_all: Start, foreign: Ask, tmp_path_factory: pytest.TempPathFactory) -> None:
    """One that takes TwistStamped and clamps, and one as it is by default."""
    text = read_text("cart")
    for before, after in SETTINGS.items():
        assert before in text
        text = text.replace(before, after)
    path = tmp_path_factory.mktemp("robot") / "stamped.yaml"
    path.write_text(text, "utf-8")
    start_for_all("stamped", "run", str(path), "--ros", "--no-log", "--namespace", "/stamped")
    start_for_all("plain", "run", "cart", "--ros", "--no-log", "--namespace", "/plain")
    for namespace in ("/stamped", "/plain"):
        assert foreign("wait_for", node="model", namespace=namespace)


def set_points(foreign: Ask, robot: str, key: str, least: int) -> dict[str, Any]:
    """The counts of set-points, once there are so many."""
    found: dict[str, Any] = receive_until(
        foreign, f"{robot}/diagnostics", lambda all_: int(all_["cart: set-points"].get(key, 0)) >= least
    )
    return found["cart: set-points"]  # type: ignore[no-any-return]  # JSON


def send(foreign: Ask, topic: str, linear: float, stamp_ns: int = 0) -> None:
    assert foreign("publish", topic=topic, kind="TwistStamped", linear=linear, angular=0.0, stamp_ns=stamp_ns)


@pytest.mark.parametrize("topic", ["/stamped/cmd_vel", "/stamped/cmd_vel_stamped", "/plain/cmd_vel_stamped"])
def test_a_stamp_of_zero_means_now(foreign: Ask, topic: str) -> None:
    robot = topic.rpartition("/")[0]
    foreign("listen", topic=f"{robot}/setpoint")

    def is_it(message: dict[str, Any]) -> bool:
        return bool(message["linear"] == 0.25)

    foreign("receive", topic=f"{robot}/odom")
    send(foreign, topic, 0.25)
    send(foreign, topic, 0.25)
    assert receive_until(foreign, f"{robot}/setpoint", is_it)
    assert "refused.stale" not in set_points(foreign, robot, "applied", 2)


def test_cmd_vel_with_a_stamp_comes_into_force_at_its_stamp(foreign: Ask) -> None:
    now_ns = receive_until(foreign, "/stamped/odom", lambda _: True)["stamp_ns"]
    for ahead_ns, linear in ((3_000_000_000, 0.0), (2_000_000_000, 0.375)):  # the first holds the time base
        send(foreign, "/stamped/cmd_vel", linear, now_ns + ahead_ns)
    applied = receive_until(foreign, "/stamped/setpoint", lambda message: message["linear"] == 0.375)
    assert applied["stamp_ns"] == now_ns + 2_000_000_000


def test_a_set_point_beyond_the_limits_is_clamped_and_counted(foreign: Ask) -> None:
    foreign("listen", topic="/stamped/setpoint")
    send(foreign, "/stamped/cmd_vel", 7.0)
    assert receive_until(foreign, "/stamped/setpoint", lambda message: message["linear"] == 0.5)
    found = set_points(foreign, "/stamped", "clamped", 1)
    assert "refused.too_large" not in found


def test_a_set_point_beyond_the_limits_is_refused_and_counted_by_default(foreign: Ask) -> None:
    assert foreign("publish", topic="/plain/cmd_vel", kind="Twist", linear=70.0, angular=0.0)
    assert "clamped" not in set_points(foreign, "/plain", "refused.too_large", 1)


def test_a_stamped_twist_for_a_robot_that_takes_none_is_reported_with_the_setting(
    start: Start, foreign: Ask, messages: Path
) -> None:
    start("other", "run", "cart", "--ros", "--no-log", "--namespace", "/other")
    assert foreign("advertise", topic="/other/cmd_vel", kind="TwistStamped", best_effort=False)
    expected = (
        "segway-ecc: /foreign publishes geometry_msgs/msg/TwistStamped on /other/cmd_vel, which takes "
        "geometry_msgs/msg/Twist: they never meet. Publish geometry_msgs/msg/Twist, set ros.cmd_vel: TwistStamped in "
        "the robot file, or remap it away"
    )
    text = messages / "other.txt"
    for _ in range(2000):
        foreign("receive", topic="/other/odom")
        if expected in text.read_text().splitlines():
            return
    pytest.fail(text.read_text())
