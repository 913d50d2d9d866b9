# SPDX-License-Identifier: MIT
"""How the covariances of odometry grow: with the way, with turning, with slip; and never beyond numbers."""

import math
import random
import statistics
from itertools import pairwise

import pytest

from segway_ecc.node.cycle.interfaces import Report
from segway_ecc.node.cycle.signals import IMU_SIGNALS, ODOMETRY_SIGNALS
from segway_ecc.node.ros.uncertainty import OdometryUncertainty
from segway_ecc.node.safety.modes import Mode

PERIOD_NS = 10_000_000
WHEELED = (*ODOMETRY_SIGNALS, "left.angle", "right.angle", "left.velocity", "right.velocity", *IMU_SIGNALS)
RADIUS = 0.05


def report(cycle: int, *values: float) -> Report:
    return Report(cycle * PERIOD_NS, Mode.ARMED, values, None, cycle=cycle)


def driven(way: list[tuple[float, float, float]]) -> OdometryUncertainty:
    found = OdometryUncertainty(ODOMETRY_SIGNALS)
    for cycle, (x, y, heading) in enumerate(way):
        found.update(report(cycle, x, y, heading, 0.0, 0.0))
    return found


def straight(metres: float) -> OdometryUncertainty:
    return driven([(metres * step / 100, 0.0, 0.0) for step in range(101)])


def test_a_robot_that_rests_is_as_certain_as_at_its_start() -> None:
    assert driven([(1.0, 2.0, 3.0)] * 100).pose == (0.0,) * 6


def test_uncertainty_grows_with_the_way() -> None:
    first, second = straight(1.0).pose, straight(10.0).pose
    assert math.sqrt(first.xx) == pytest.approx(0.01)
    assert math.sqrt(second.xx) == pytest.approx(0.01 * math.sqrt(10.0))
    assert second.hh == pytest.approx(10.0 * first.hh)
    assert second.yy > 10.0 * first.yy, "an error of the heading carries the robot aside"
    assert abs(second.xy) < 1e-12
    assert second.yh > 0.0


def test_uncertainty_of_the_heading_grows_as_the_robot_turns_on_the_spot() -> None:
    pose = driven([(0.0, 0.0, step / 100) for step in range(101)]).pose
    assert math.sqrt(pose.hh) == pytest.approx(0.02)
    assert (pose.xx, pose.yy) == (0.0, 0.0)


def test_the_covariance_is_that_of_many_robots_which_err_so() -> None:
    chance, ends = random.Random(1), []  # noqa: S311 - no secret
    way = [(math.cos(step / 20) - 1.0, math.sin(step / 20), step / 20 + math.pi / 2) for step in range(61)]
    expected = driven(way).pose
    for _ in range(3000):
        x = y = off = 0.0
        for (x0, y0, h0), (x1, y1, h1) in pairwise(way):
            step, turn = math.hypot(x1 - x0, y1 - y0), abs(h1 - h0)
            dx, dy = x1 - x0, y1 - y0
            x += dx * math.cos(off) - dy * math.sin(off) + chance.gauss(0.0, math.sqrt(1e-4 * step))
            y += dx * math.sin(off) + dy * math.cos(off) + chance.gauss(0.0, math.sqrt(1e-4 * step))
            off += chance.gauss(0.0, math.sqrt(1e-4 * step + 4e-4 * turn))
        ends.append((x, y, off))
    xs, ys, headings = zip(*ends, strict=True)
    found = (
        statistics.variance(xs),
        statistics.covariance(xs, ys),
        statistics.covariance(xs, headings),
        statistics.variance(ys),
        statistics.covariance(ys, headings),
        statistics.variance(headings),
    )
    assert found == pytest.approx(expected, rel=0.1, abs=1e-5)


def leaning(slip: float, yaw_slip: float, heading: float = 0.0) -> OdometryUncertainty:
    """One that rests for a second while its wheels, or its odometry, turn."""
    found = OdometryUncertainty(WHEELED, RADIUS, leans=True)
    for cycle in range(101):
        odometry = 0.0, 0.0, heading, 0.0, yaw_slip
        found.update(report(cycle, *odometry, 0.0, 0.0, slip / RADIUS, slip / RADIUS, *[0.0] * 6))
    return found


@pytest.mark.parametrize("slip", [0.5, -0.5])
def test_slip_along_the_way_adds_what_may_have_been_slipped(slip: float) -> None:
    found = leaning(slip, 0.0)
    assert math.sqrt(found.pose.xx) == pytest.approx(0.45)
    assert (found.pose.yy, found.pose.hh) == (0.0, 0.0)
    assert math.sqrt(found.twist.ahead) == pytest.approx(0.46)
    aside = leaning(slip, 0.0, heading=math.pi / 2).pose
    assert math.sqrt(aside.yy) == pytest.approx(0.45)
    assert aside.xx == pytest.approx(0.0)


def test_a_turn_that_the_gyro_does_not_measure_adds_to_the_heading() -> None:
    found = leaning(0.0, 0.6)
    assert math.sqrt(found.pose.hh) == pytest.approx(0.5)
    assert math.sqrt(found.twist.yaw) == pytest.approx(0.01 + 0.02 * 0.6 + 0.5)


def test_what_differs_also_where_nothing_slips_adds_nothing() -> None:
    assert leaning(0.05, 0.1).pose == (0.0,) * 6


def test_a_body_that_leans_turns_its_encoders_and_slips_nothing() -> None:
    found = OdometryUncertainty(WHEELED, RADIUS, leans=True)
    for cycle in range(11):  # it falls forward about wheels that rest: the encoders turn back
        found.update(report(cycle, *[0.0] * 5, 0.0, 0.0, -2.0, -2.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0))
    assert found.pose == (0.0,) * 6


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_finite_is_passed_over(bad: float) -> None:
    found = straight(1.0)
    before = found.pose
    found.update(report(101, bad, 0.0, 0.0, 0.0, 0.0))
    assert found.pose == before
    found.update(report(102, 1.0, 0.0, 0.0, 0.0, 0.0))
    assert found.pose == before


def test_an_imu_that_is_not_measured_shows_no_slip() -> None:
    found = OdometryUncertainty(WHEELED, RADIUS, leans=True)
    for cycle in range(11):
        found.update(report(cycle, *[0.0] * 5, *[math.nan] * 10))
    assert found.pose == (0.0,) * 6


def test_a_report_counts_once_and_a_pause_no_more_than_a_tenth_of_a_second() -> None:
    found = OdometryUncertainty(WHEELED, RADIUS, leans=True)
    values = *[0.0] * 5, 0.0, 0.0, 21.0, 21.0, *[0.0] * 6
    for cycle in (0, 0, 1000, 1000):
        found.update(report(cycle, *values))
    assert math.sqrt(found.pose.xx) == pytest.approx(0.1)


def test_however_far_a_pose_leaps_the_covariance_is_finite() -> None:
    pose = driven([(10.0**step, -(10.0**step), 10.0**step) for step in range(0, 300, 10)]).pose
    assert all(map(math.isfinite, pose))
