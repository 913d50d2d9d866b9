# SPDX-License-Identifier: MIT
"""The least friction on which a robot gets up: the equations by numbers, and the plant with contact at its limit."""

import dataclasses

import pytest

from segway_ecc.hil.floor.least_friction import rising_limit
from segway_ecc.hil.plants import contact_body
from segway_ecc.hil.plants.segway_body import SegwayBody
from segway_ecc.hil.plants.segway_contact import SegwayContactTorquePlant
from segway_ecc.node.models.segway_parameters import PUBLISHED, SegwayParameters

SMOOTH = dataclasses.replace(PUBLISHED, coulomb_friction=0.0, viscous_friction=0.0)
TALL = dataclasses.replace(SMOOTH, body_height_of_centre=0.5, wheel_mass=1.0, wheel_inertia=0.002, stop_angle=0.4)
FASTEST = 60.0
"""Of a wheel, rad/s: the packaged robots' limit."""


@pytest.mark.parametrize("p", [SMOOTH, TALL], ids=["published", "tall"])
def test_at_the_limit_the_body_of_the_rolling_plant_just_does_not_rise(p: SegwayParameters) -> None:
    limit, body = rising_limit(p), SegwayBody(p)
    acceleration, pitch_acceleration, _ = body.accelerations(0.0, 0.0, 0.0, p.stop_angle, limit.torque, limit.torque)
    assert pitch_acceleration == pytest.approx(0.0, abs=1e-9)
    assert acceleration == pytest.approx(limit.acceleration)
    assert limit.friction == pytest.approx(acceleration / p.gravity)


def test_the_published_robot_needs_what_the_documentation_has() -> None:
    limit = rising_limit(PUBLISHED)
    assert limit.friction == pytest.approx(0.447, abs=5e-4)
    assert limit.torque == pytest.approx(0.60, abs=5e-3)


@pytest.fixture
def sliding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bumpers that slide: the equations know no other, and one that holds to the floor helps to raise the body."""
    monkeypatch.setattr(contact_body, "_BUMPER_FRICTION", 0.01)


def _lowest(friction: float, share: float, side: float, fastest: float = 1e9) -> float:
    """The least pitch towards the bumper's side while a steady torque acts, a share of what makes a wheel slip, rad.

    It ends where a wheel is faster than `fastest`, rad/s.
    """
    limit = rising_limit(SMOOTH)
    torque = side * share * limit.torque * friction / limit.friction
    quiet = {"SensorErrors": 0.0, "CoulombFriction": 0.0, "ViscousFriction": 0.0}
    plant = SegwayContactTorquePlant({**quiet, "InitialPitch": side * SMOOTH.stop_angle})
    plant.initialize((0.0, 0.0))
    for name in ("LeftFriction", "RightFriction"):
        plant.write(name, friction)
    lowest = SMOOTH.stop_angle
    for step in range(1500):
        plant.step((torque * min(1.0, step / 200.0),) * 2)
        if abs(plant.read("left.velocity")) > fastest:
            break
        lowest = min(lowest, side * plant.read("truth.pitch"))
    return lowest


@pytest.mark.usefixtures("sliding")
@pytest.mark.mujoco
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["front", "rear"])
def test_just_below_slipping_it_rises_just_above_the_limit_and_not_below(side: float) -> None:
    least = rising_limit(SMOOTH).friction
    assert _lowest(1.03 * least, 0.99, side) < 0.0, "past upright"
    assert _lowest(0.95 * least, 0.99, side) > 0.9 * SMOOTH.stop_angle, "the tyres creep, and the bumper gives way"


@pytest.mark.usefixtures("sliding")
@pytest.mark.mujoco
@pytest.mark.parametrize("share", [1.2, 2.0])
def test_below_the_limit_more_torque_spins_the_wheels_and_raises_nothing(share: float) -> None:
    assert _lowest(0.95 * rising_limit(SMOOTH).friction, share, 1.0, FASTEST) > 0.9 * SMOOTH.stop_angle
