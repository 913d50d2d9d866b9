# SPDX-License-Identifier: MIT
"""Segways one of whose gains is a 57th of its design, as radians where degrees are meant give it."""

import math

import pytest

from segway_ecc.hil.campaign.run import run_scenario
from segway_ecc.hil.campaign.scenario import Expectation, Scenario, ScenarioResult, ScenarioRun
from segway_ecc.node.config import load_robot
from segway_ecc.node.models.segway import GAINS
from segway_ecc.node.sequence.manoeuvre import Segment

ROBOTS = ("segway", "segway-odrive")
NAMES = [variable.name for variable in GAINS]
HOLD_UP = ("PitchGain", "PitchRateGain", "VelocityGain")
STANDS_UP = Scenario(
    name="test",
    robot=ROBOTS,
    segments=(
        Segment(linear=0.0, duration=3.0),
        Segment(linear=0.3, angular=0.3, duration=1.2),
        Segment(linear=0.1, angular=-0.3, duration=1.0),
        Segment(linear=0.3, duration=3.0),
    ),
    expect=Expectation(outcome="drives_on"),
)
REASONS = ("allowed is -60 to 60 rad/s", "the robot runs away", "the robot has fallen")


def driven(robot: str, *names: str) -> ScenarioResult:
    """What comes of a robot that stands up and drives with these gains a 57th of their design."""
    design = load_robot(robot).model.parameters
    small = {f"model.{name}": math.radians(design[name]) for name in names}
    return run_scenario(ScenarioRun("test", STANDS_UP, robot, 0, small))


@pytest.mark.parametrize(("robot", "names"), [(r, n) for n in (*([n] for n in HOLD_UP), NAMES) for r in ROBOTS])
@pytest.mark.variants(2)
def test_segway_that_cannot_stand_has_fallen_with_a_reason_and_zero_torque(robot: str, names: list[str]) -> None:
    result = driven(robot, *names)
    assert (result.outcome, result.posture) == ("faults", "FALLEN")
    assert any(reason in result.reason for reason in REASONS)
    assert result.safe_s is not None
    assert result.detection_s is not None
    assert result.safe_s <= result.detection_s + 0.005


@pytest.mark.parametrize(("robot", "name"), [(r, n) for n in NAMES if n not in HOLD_UP for r in ROBOTS])
@pytest.mark.variants(1)
def test_segway_stands_and_drives_without_any_of_the_other_gains(robot: str, name: str) -> None:
    result = driven(robot, name)
    assert (result.outcome, result.posture) == ("drives_on", "BALANCING")
    assert result.max_tilt_rad is not None
    assert result.max_tilt_rad < 0.1
