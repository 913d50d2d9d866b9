# SPDX-License-Identifier: MIT
"""The law alone, with gains that are easy to reckon with."""

import pytest

from segway_ecc.node.models.segway import SegwayController
from segway_ecc.node.models.segway_estimate import Estimate
from segway_ecc.node.models.segway_law import Law, Motion, torques

GAINS = {
    "TravelGain": -1.0,
    "VelocityGain": -2.0,
    "PitchGain": -10.0,
    "PitchRateGain": -3.0,
    "SentGain": 0.25,
    "SentBeforeGain": 0.125,
    "IntegralGain": -0.5,
    "PitchPerAcceleration": 0.1,
    "TorquePerAcceleration": 0.3,
    "HeadingGain": 1.0,
    "YawRateGain": 0.5,
    "TorquePerYawAcceleration": 0.04,
}
PARAMETERS = {**{v.name: v.value for v in SegwayController.parameters}, **GAINS}
LAW = Law(0.005, PARAMETERS)


def sent(motion: Motion, estimate: Estimate) -> float:
    return LAW.balanced(motion, estimate, 1.3).sent


def test_a_robot_that_does_as_its_reference_is_sent_what_the_reference_takes() -> None:
    motion = Motion(travel=3.0, velocity=0.5, acceleration=1.5, sent=0.45, sent_before=0.45)
    assert sent(motion, Estimate(travel=3.0, velocity=0.5, pitch=0.15)) == pytest.approx(0.45)


@pytest.mark.parametrize(
    ("motion", "estimate", "expected"),
    [
        (Motion(), Estimate(travel=0.1), 0.1),
        (Motion(), Estimate(velocity=0.1), 0.2),
        (Motion(), Estimate(pitch=0.1), 1.0),
        (Motion(), Estimate(pitch_rate=0.1), 0.3),
        (Motion(sent=0.4), Estimate(), -0.1),
        (Motion(sent_before=0.4), Estimate(), -0.05),
        (Motion(integral=0.2), Estimate(), 0.1),
        (Motion(travel=0.1), Estimate(), -0.1),
        (Motion(velocity=0.1), Estimate(), -0.2),
        (Motion(acceleration=1.0), Estimate(), 0.3 - 1.0 + 0.075 + 0.0375),
    ],
)
def test_each_error_is_answered_by_its_gain(motion: Motion, estimate: Estimate, expected: float) -> None:
    assert sent(motion, estimate) == pytest.approx(expected)


def test_heading_and_yaw_rate_turn_the_robot_back() -> None:
    moved = LAW.balanced(Motion(heading=0.1, yaw_rate=0.2, yaw_acceleration=1.0), Estimate(), 1.3)
    assert moved.turning == pytest.approx(0.1 + 0.1 + 0.04)
    assert torques(moved) == pytest.approx((-0.12, 0.12))


def test_what_is_sent_is_remembered_limited_and_changes_no_faster_than_allowed() -> None:
    first = LAW.balanced(Motion(sent=0.5), Estimate(pitch=1.0), 1.3)
    assert (first.sent, first.sent_before) == (2.6, 0.5)
    slow = Law(0.005, {**PARAMETERS, "TorqueSlew": 10.0}).balanced(Motion(), Estimate(pitch=1.0), 1.3)
    assert slow.sent == pytest.approx(0.05)


def test_a_reference_further_off_than_allowed_follows_the_robot() -> None:
    far = LAW.ramped(Motion(travel=2.0, heading=-2.0), Estimate(), 0.0, 0.0)
    assert (far.travel, far.heading) == (0.5, -0.5)
