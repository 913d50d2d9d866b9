# SPDX-License-Identifier: MIT
"""The cart on four wheels against the closed form of its equations."""

import math

import pytest

from segway_ecc.hil.plants.skid_steer import SkidSteerPlant

SECONDS = 2.0


@pytest.fixture
def plant() -> SkidSteerPlant:
    made = SkidSteerPlant()
    made.initialize([0.0, 0.0])
    return made


def test_a_constant_force_brings_it_to_its_speed_as_a_first_order_lag(plant: SkidSteerPlant) -> None:
    for _ in range(round(SECONDS / plant.step_size)):
        speed, _, way, turn, x, y, *_ = plant.step([16.0, 0.0])
    lag_s = 20.0 / 8.0
    assert speed == pytest.approx(2.0 * (1.0 - math.exp(-SECONDS / lag_s)), rel=1e-9)
    assert way == pytest.approx(2.0 * (SECONDS - lag_s * (1.0 - math.exp(-SECONDS / lag_s))), rel=1e-9)
    assert x == pytest.approx(way)
    assert (turn, y) == (0.0, 0.0)


def test_force_and_moment_that_friction_takes_drive_it_on_a_circle(plant: SkidSteerPlant) -> None:
    for _ in range(25_000):  # until it is as fast as it gets
        plant.step([8.0, 3.0])
    assert plant.s[:2] == pytest.approx([1.0, 0.5], rel=1e-3)
    _, _, _, _, x, y, heading, *_ = plant.step([8.0, 3.0])
    centre = (x - 2.0 * math.sin(heading), y + 2.0 * math.cos(heading))
    for _ in range(3000):
        _, _, _, _, x, y, heading, *_ = plant.step([8.0, 3.0])
        assert math.dist((x, y), centre) == pytest.approx(2.0, rel=1e-2)
