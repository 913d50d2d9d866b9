# SPDX-License-Identifier: MIT
"""What an edge asks of a robot: the documentation's figures, and the fall of a body whose axle was stopped."""

import math

import pytest

from segway_ecc.hil.floor.edge_limit import caught_speed, edge_limit
from segway_ecc.node.models.segway import SegwayController
from segway_ecc.node.models.segway_parameters import PUBLISHED

TORQUE_LIMIT = next(v.value for v in SegwayController.parameters if v.name == "TorqueLimit")


@pytest.mark.parametrize(
    ("height", "friction", "torque"), [(0.003, 0.36, 0.45), (0.01, 0.75, 0.78), (0.02, 1.33, 1.05)]
)
def test_the_published_robot_needs_what_the_documentation_has(height: float, friction: float, torque: float) -> None:
    limit = edge_limit(PUBLISHED, height)
    assert limit.friction == pytest.approx(friction, abs=5e-3)
    assert limit.torque == pytest.approx(torque, abs=5e-3)


def test_the_edge_carries_the_weight_within_its_cone_of_friction_and_the_torque_holds_it() -> None:
    height, radius = 0.01, PUBLISHED.wheel_radius
    ahead, above = math.sqrt(radius**2 - (radius - height) ** 2), radius - height
    limit = edge_limit(PUBLISHED, height)
    weight = 0.5 * (PUBLISHED.body_mass + 2.0 * PUBLISHED.wheel_mass) * PUBLISHED.gravity
    assert limit.torque == pytest.approx(weight * ahead)
    assert limit.friction == pytest.approx(ahead / above)


@pytest.mark.parametrize("share", [0.98, 1.02])
def test_a_body_whose_axle_stops_is_caught_below_the_limit_and_falls_above(share: float) -> None:
    p = PUBLISHED
    moment = p.body_mass * p.body_height_of_centre
    inertia = p.body_pitch_inertia + moment * p.body_height_of_centre
    pitch, rate, step = 0.0, moment * share * caught_speed(p, TORQUE_LIMIT) / inertia, 1e-4
    while rate > 0.0 and pitch < 1.0:
        rate += step * (moment * p.gravity * math.sin(pitch) - 2.0 * TORQUE_LIMIT) / inertia
        pitch += step * rate
    assert (rate <= 0.0) == (share < 1.0)


def test_the_published_robot_is_caught_from_the_speed_that_the_documentation_has() -> None:
    assert caught_speed(PUBLISHED, TORQUE_LIMIT) == pytest.approx(0.357, abs=5e-4)
