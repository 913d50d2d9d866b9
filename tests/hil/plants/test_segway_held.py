# SPDX-License-Identifier: MIT
"""The segway in a person's hands."""

import math

import pytest

from segway_ecc.hil.plants.segway_held import HeldSegwayPlant, HeldSegwayTorquePlant

PERFECT = {"SensorErrors": 0.0}
REST = (0.0, 0.0)
RADIUS, TRACK = 0.05, 0.3048
INERTIA, COULOMB, VISCOUS = 1.723e-4, 0.02, 1e-4
RATES = tuple(f"imu.angular_velocity_{axis}" for axis in "xyz")
FORCES = tuple(f"imu.linear_acceleration_{axis}" for axis in "xyz")


def moved(
    plant: HeldSegwayPlant | HeldSegwayTorquePlant, seconds: float, **states: float
) -> tuple[dict[str, float], list[float]]:
    """Outputs after some seconds in which hands did as the states say, and the angles that the gyro turned through."""
    for name, value in states.items():
        plant.write(name, value)
    turned, shown = [0.0, 0.0, 0.0], dict[str, float]()
    for _ in range(round(seconds / plant.step_size)):
        outputs = plant.step(REST)
        shown = dict(zip((v.name for v in plant.outputs), outputs, strict=True))
        turned = [angle + plant.step_size * shown[rate] for angle, rate in zip(turned, RATES, strict=True)]
    return shown, turned


@pytest.fixture
def plant() -> HeldSegwayPlant:
    """At rest in the air, with perfect sensors."""
    plant = HeldSegwayPlant(PERFECT)
    plant.initialize(REST)
    return plant


def test_upright_and_at_rest_it_feels_gravity_alone(plant: HeldSegwayPlant) -> None:
    shown, turned = moved(plant, 1.0)
    assert [shown[name] for name in FORCES] == pytest.approx([0.0, 0.0, 9.80665])
    assert turned == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("state", "angle", "turned", "felt"),
    [
        ("HandPitch", 0.7, [0.0, 0.7, 0.0], [-math.sin(0.7), 0.0, math.cos(0.7)]),
        ("HandRoll", 0.7, [0.7, 0.0, 0.0], [0.0, math.sin(0.7), math.cos(0.7)]),
        ("HandYaw", 1.5, [0.0, 0.0, 1.5], [0.0, 0.0, 1.0]),
    ],
)
def test_hands_turn_it_about_one_axis(
    plant: HeldSegwayPlant, state: str, angle: float, turned: list[float], felt: list[float]
) -> None:
    shown, gyro = moved(plant, 4.0, **{state: angle})
    assert gyro == pytest.approx(turned, abs=2e-3)
    assert [shown[name] for name in FORCES] == pytest.approx([9.80665 * share for share in felt], abs=2e-2)


def test_wheels_roll_on_the_floor(plant: HeldSegwayPlant) -> None:
    shown, _ = moved(plant, 5.0, OnFloor=1.0, HandTravel=1.0)
    assert shown["left.angle"] == shown["right.angle"] == pytest.approx(1.0 / RADIUS, rel=1e-3)
    assert shown["truth.x"] == pytest.approx(1.0, rel=1e-3)

    shown, _ = moved(plant, 8.0, HandYaw=2.0 * math.pi)
    apart = shown["right.angle"] - shown["left.angle"]
    assert apart == pytest.approx(2.0 * math.pi * TRACK / RADIUS, rel=1e-3)


def test_a_hand_turns_one_wheel_in_the_air(plant: HeldSegwayPlant) -> None:
    shown, _ = moved(plant, 4.0, LeftTurn=2.0 * math.pi)
    assert shown["left.angle"] == pytest.approx(2.0 * math.pi, rel=3e-3)
    assert shown["right.angle"] == 0.0


def test_torque_turns_a_wheel_in_the_air_against_its_friction() -> None:
    plant = HeldSegwayTorquePlant(PERFECT)
    plant.initialize(REST)
    for _ in range(50):
        outputs = plant.step((0.06, 0.0))
    shown = dict(zip((v.name for v in plant.outputs), outputs, strict=True))

    # I dw/dt = torque - coulomb - viscous w, after the 1 ms in which the drive gives its torque.
    settled, rate = (0.06 - COULOMB) / VISCOUS, VISCOUS / INERTIA
    assert shown["left.velocity"] == pytest.approx(settled * (1.0 - math.exp(-rate * 0.049)), rel=0.03)
    assert shown["right.velocity"] == 0.0


def test_same_seed_gives_the_same_run() -> None:
    runs = []
    for _ in range(2):
        plant = HeldSegwayPlant({"Seed": 3.0})
        plant.initialize(REST)
        runs.append(moved(plant, 0.2, HandPitch=0.3))
    assert runs[0] == runs[1]
