# SPDX-License-Identifier: MIT
"""Real robots and subscribers, over real DDS: that they run and are counted; no times."""

import pytest

from segway_ecc.hil.growth import real
from segway_ecc.hil.growth.cost import Axis

pytestmark = pytest.mark.ros


def test_a_subscriber_receives_from_a_robot_that_reports_its_cost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(real, "MEASURED_S", 0.5)
    point = real.subscribers(1)
    assert (point.axis, point.size) == (Axis.SUBSCRIBERS, 1)
    assert point.cost is not None
    assert point.cost.p50_us > 0.0
    assert set(point.cost.notes) == {"share of a core, all threads", "cycles that began late"}


def test_robots_run_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(real, "MEASURED_S", 0.5)
    point = real.robots(2)
    assert (point.axis, point.size) == (Axis.ROBOTS, 2)
    assert point.cost is not None
