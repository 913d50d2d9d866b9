# SPDX-License-Identifier: MIT
"""The published robot: its numbers against what any solid body obeys, and their names as a model's parameters."""

import dataclasses

import pytest

from segway_ecc.node.models.segway_parameters import PUBLISHED, VARIABLES, SegwayParameters


def test_every_field_is_a_parameter_with_its_unit() -> None:
    assert len(VARIABLES) == len(dataclasses.fields(SegwayParameters))
    units = {v.name: (v.unit, v.value) for v in VARIABLES}
    assert units["BodyHeightOfCentre"] == ("m", PUBLISHED.body_height_of_centre)
    assert units["MotorConstant"] == ("N m/A", PUBLISHED.motor_constant)


def test_goes_into_a_models_parameters_and_back() -> None:
    values = {v.name: v.value for v in VARIABLES}
    assert SegwayParameters.from_model(values) == PUBLISHED
    assert SegwayParameters.from_model({**values, "Track": 0.4}) == dataclasses.replace(PUBLISHED, track=0.4)


def test_the_body_can_exist() -> None:
    """No moment of inertia exceeds the sum of the other two; a wheel has half its axle's about a diameter, or more."""
    moments = sorted((PUBLISHED.body_pitch_inertia, PUBLISHED.body_roll_inertia, PUBLISHED.body_yaw_inertia))
    assert moments[2] <= moments[0] + moments[1]
    assert 0.5 * PUBLISHED.wheel_inertia <= PUBLISHED.wheel_diameter_inertia
    assert PUBLISHED.wheel_inertia <= PUBLISHED.wheel_mass * PUBLISHED.wheel_radius**2


def test_weighs_what_the_links_weigh() -> None:
    """Of the URDF, kg: torso, battery, handle; per leg, stators, rotors, horns, sticks, knee, ankle, plate, stator."""
    leg = 2 * (0.47 + 0.015 + 0.05267 + 0.056) + 0.09874 + 0.07863 + 0.02 + 0.1721
    assert pytest.approx(1 + 0.8 + 0.0525 + 2 * leg, abs=1e-3) == PUBLISHED.body_mass
    assert pytest.approx(0.05 + 0.0454 + 0.08715, abs=1e-4) == PUBLISHED.wheel_mass
