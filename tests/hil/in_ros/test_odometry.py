# SPDX-License-Identifier: MIT
"""Odometry and attitude of a simulated robot, as a foreign node receives them."""

import math
from pathlib import Path

import pytest

from tests.ros_processes import Ask, Start, receive_until

pytestmark = pytest.mark.ros

MODEL = '''
from segway_ecc.node.models.cart import Cart


class Failing(Cart):
    """A cart whose position is not a number from a metre on."""

    def step(self, u):
        y = list(super().step(u))
        return [float("nan") if y[0] > 1.0 and place == 0 else value for place, value in enumerate(y)]
'''


def test_a_segway_has_an_attitude_and_odometry_that_grows_uncertain(start: Start, foreign: Ask) -> None:
    start("segway", "lock-step", "segway", "--speed", "4")
    upright = receive_until(foreign, "/imu/data", lambda imu: abs(imu["orientation"][1]) < 0.02)
    x, y, z, w = upright["orientation"]
    assert x * x + y * y + z * z + w * w == pytest.approx(1.0)
    early = foreign("receive", topic="/odom")[-1]

    def is_further(odom: dict[str, float]) -> bool:
        assert foreign("publish", topic="/cmd_vel", kind="Twist", linear=0.4, angular=0.0)
        return math.hypot(odom["x"] - early["x"], odom["y"] - early["y"]) > 1.0

    late = receive_until(foreign, "/odom", is_further)
    assert all(after > before for before, after in zip(early["variances"], late["variances"], strict=True))
    assert 0.005 < math.sqrt(late["variances"][0]) < 0.2
    assert foreign("call", service="/model/sit_down")[0]
    leaning = receive_until(foreign, "/imu/data", lambda imu: abs(imu["orientation"][1]) > 0.2)
    assert leaning["orientation_covariance"][0] > 0.0, "it rests on its stop at 0.5 rad"


def test_no_odometry_that_is_not_a_number_is_published_after_a_fault(
    start: Start, foreign: Ask, tmp_path: Path
) -> None:
    (tmp_path / "failing_cart.py").write_text(MODEL, "utf-8")
    path = tmp_path / "failing.yaml"
    robot = (Path(__file__).parents[3] / "node" / "robots" / "cart.yaml").read_text("utf-8")
    path.write_text(robot.replace("segway_ecc.node.models.cart:Cart", "failing_cart:Failing"), "utf-8")
    start("failing", "lock-step", str(path), "--namespace", "/failing", "--speed", "4")
    foreign("listen", topic="/failing/odom")

    def is_fault(mode: dict[str, str]) -> bool:
        foreign("publish", topic="/failing/cmd_vel", kind="Twist", linear=2.0, angular=0.0)
        return mode["mode"] == "FAULT"

    fault = receive_until(foreign, "/failing/mode", is_fault)
    assert "not finite" in fault["reason"] or "nan" in fault["reason"]
    seen = foreign("receive", topic="/failing/odom")
    numbers = [odom[key] for odom in seen for key in ("x", "y", "z", "w", "linear", "angular")]
    assert all(map(math.isfinite, numbers))
