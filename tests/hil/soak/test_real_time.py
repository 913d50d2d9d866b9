# SPDX-License-Identifier: MIT
"""A robot, its recorder, plant and station in real time, over real DDS: that all of them are watched; no times."""

import json
from pathlib import Path

import pytest

from segway_ecc.hil.soak.real_time import RealTimeSoak, soak
from segway_ecc.hil.soak.watching import Watching, figure

pytestmark = pytest.mark.real_time


@pytest.mark.proof
@pytest.mark.ros
def test_every_process_is_watched_and_the_robot_driven(tmp_path: Path) -> None:
    watching, told = Watching(tmp_path), list[float]()
    ran = soak(RealTimeSoak("cart-can", 14.0, 0.5, ros=True), watching, told.append)
    assert {s.process for s in watching.series} == {"node", "plant", "station", "recorder", "ros", "log"}
    assert ran.node["cycles"] == 1400
    assert any(mode.startswith("ARMED") for mode in ran.modes)
    assert told == sorted(told)
    assert figure(watching.series).count(b"open files") == 5


def test_without_ros_nobody_drives(tmp_path: Path) -> None:
    watching = Watching(tmp_path)
    ran = soak(RealTimeSoak("cart-can", 5.0, 0.5, ros=False), watching, lambda _: None)
    assert ran.modes == {}
    assert {s.process for s in watching.series} >= {"node", "plant", "log"}
    json.dumps(ran.node)
