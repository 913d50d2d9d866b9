# SPDX-License-Identifier: MIT
"""Every input that is tried, by its item."""

from collections.abc import Sequence
from typing import Final

from segway_ecc.hil.inputs import (
    bus,
    endings,
    falling,
    gaps,
    misbehaving_models,
    operators,
    parameters,
    robot_files,
    ros_helper,
)
from segway_ecc.hil.inputs.trial import InputTrial

ITEMS: Final = {
    1: "parameters",
    2: "models that misbehave",
    3: "robot files",
    4: "falls, and a gyro that is wrong",
    5: "gaps in telemetry",
    6: "strangers on the bus, and the guard",
    7: "signals, and a node that is held up",
    8: "operators, and others in ROS",
    9: "the ROS process",
}


def all_trials() -> Sequence[InputTrial]:
    """All, in the order of their items."""
    parts = (parameters, misbehaving_models, robot_files, falling, gaps, bus, endings, operators, ros_helper)
    return [trial for part in parts for trial in part.trials()]
