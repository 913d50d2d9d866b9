# SPDX-License-Identifier: MIT
"""The arm of three links against what mechanics says of it in other words."""

import math
from collections.abc import Sequence

import pytest

from segway_ecc.hil.plants.planar_arm import PlanarArmPlant
from segway_ecc.node.models.planar_arm import GRAVITY, HANGING

FREE = {"ShoulderFriction": 0.0, "ElbowFriction": 0.0, "WristFriction": 0.0}
LENGTHS, MASSES = (0.3, 0.25, 0.15), (1.5, 1.0, 0.5)


def energy(joints: Sequence[float], rates: Sequence[float]) -> float:
    """Of the three rods, by where their centres are and how fast these move: nothing of the plant's equations."""
    x = y = vx = vy = angle = rate = total = 0.0
    for length, mass, joint, joint_rate in zip(LENGTHS, MASSES, joints, rates, strict=True):
        angle, rate = angle + joint, rate + joint_rate
        half = 0.5 * length
        cx, cy = vx - half * rate * math.sin(angle), vy + half * rate * math.cos(angle)
        total += 0.5 * mass * (cx * cx + cy * cy) + 0.5 * mass * length**2 / 12.0 * rate**2
        total += mass * GRAVITY * (y + half * math.sin(angle))
        x, y = x + length * math.cos(angle), y + length * math.sin(angle)
        vx, vy = vx - length * rate * math.sin(angle), vy + length * rate * math.cos(angle)
    return total


def test_without_torque_and_friction_energy_stays() -> None:
    plant = PlanarArmPlant(FREE)
    plant.initialize([0.0] * 3)
    for name, value in {"Shoulder": 0.4, "Elbow": -0.9, "Wrist": 1.2, "WristRate": 2.0}.items():
        plant.write(name, value)
    first = energy(plant.s[:3], plant.s[3:])
    for _ in range(1000):
        *_, reported = plant.step([0.0] * 3)
        found = energy(plant.s[:3], plant.s[3:])
        assert found == pytest.approx(first, abs=1e-6)
        assert reported == pytest.approx(found, abs=1e-12)
    assert max(map(abs, plant.s[3:])) > 1.0, "it swings"


def test_energy_is_what_the_motors_give_less_what_friction_takes() -> None:
    plant = PlanarArmPlant()
    plant.initialize([0.0] * 3)
    frictions, torques, work = (0.3, 0.1, 0.02), (2.0, -0.5, 0.3), 0.0
    first, rates = energy(plant.s[:3], plant.s[3:]), [0.0] * 3
    for _ in range(1000):
        plant.step(torques)
        now = plant.s[3:]
        for old, new, torque, friction in zip(rates, now, torques, frictions, strict=True):
            work += plant.step_size * (0.5 * (old + new) * torque - 0.5 * friction * (old**2 + new**2))
        rates = now
    assert energy(plant.s[:3], plant.s[3:]) - first == pytest.approx(work, abs=1e-4)
    assert abs(work) > 0.1


def test_torques_that_carry_the_weight_hold_it_where_it_is() -> None:
    plant = PlanarArmPlant()
    plant.initialize([0.0] * 3)
    for name in ("Shoulder", "Elbow", "Wrist"):
        plant.write(name, 0.0)
    # Level: each joint carries the rods beyond it at the distances of their centres.
    wrist = GRAVITY * 0.5 * 0.075
    elbow = GRAVITY * (1.0 * 0.125 + 0.5 * (0.25 + 0.075))
    shoulder = GRAVITY * (1.5 * 0.15 + 1.0 * (0.3 + 0.125) + 0.5 * (0.3 + 0.25 + 0.075))
    for _ in range(200):
        *found, _ = plant.step([shoulder, elbow, wrist])
    assert found == pytest.approx([0.0] * 6, abs=1e-12)


def test_it_rests_where_it_starts() -> None:
    plant = PlanarArmPlant()
    plant.initialize([0.0] * 3)
    for _ in range(200):
        *found, _ = plant.step([0.0] * 3)
    assert found == pytest.approx([*HANGING, 0.0, 0.0, 0.0], abs=1e-12)
