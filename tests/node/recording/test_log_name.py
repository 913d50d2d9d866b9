# SPDX-License-Identifier: MIT
"""Which robot a log is of, by its name."""

import pytest

from segway_ecc.node.cli.options import default_log
from segway_ecc.node.recording.log_name import robot_of_log


@pytest.mark.parametrize("robot", ["cart", "cart-can", "my-20260101T000000Z-1-robot"])
def test_a_runs_log_names_its_robot(robot: str) -> None:
    path = default_log(robot)
    assert robot_of_log(path.name) == robot
    assert robot_of_log(path.with_suffix(".whole.mcap").name) == robot


@pytest.mark.parametrize("name", ["run.mcap", "cart-20260101T000000Z.mcap", "-20260101T000000Z-1.mcap", "cart.mcap"])
def test_a_name_given_by_hand_names_no_robot(name: str) -> None:
    assert robot_of_log(name) is None
