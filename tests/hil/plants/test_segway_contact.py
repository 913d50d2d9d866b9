# SPDX-License-Identifier: MIT
"""The plant whose wheels touch the ground: against the one that cannot slip, and what only contact can do."""

import math
from collections.abc import Callable, Iterator

import pytest

from segway_ecc.hil.plants.segway import SegwayPlant, SegwayTorquePlant
from segway_ecc.hil.plants.segway_contact import SegwayContactPlant, SegwayContactTorquePlant
from segway_ecc.node.errors import ModelError
from segway_ecc.node.models.segway_parameters import PUBLISHED

pytestmark = pytest.mark.mujoco

GRIPPING = 2.0
PERFECT = {"SensorErrors": 0.0}
LAW = (-14.0, -2.2, -3.0)
"""Torque (both wheels) per pitch, pitch rate and speed that holds the robot up; N m per rad, rad/s, m/s."""
WEIGHT = (PUBLISHED.body_mass + 2.0 * PUBLISHED.wheel_mass) * PUBLISHED.gravity
Plant = SegwayTorquePlant | SegwayContactTorquePlant
Drive = Callable[[float], tuple[float, float]]


def _started(pitch: float = 0.0, friction: float = GRIPPING, **parameters: float) -> SegwayContactTorquePlant:
    plant = SegwayContactTorquePlant({**PERFECT, "InitialPitch": pitch, **parameters})
    plant.initialize((0.0, 0.0))
    plant.write("LeftFriction", friction)
    plant.write("RightFriction", friction)
    return plant


def _rest(_t: float) -> tuple[float, float]:
    return 0.0, 0.0


def _weave(t: float) -> tuple[float, float]:
    return 0.75 * math.sin(5.0 * t), 0.6 * math.sin(3.0 * t + 0.5)


def _held(plant: Plant, seconds: float, drive: Drive = _rest, speed: float = 0.0) -> Iterator[Plant]:
    """Run upright, held by a law that knows the truth, at a speed, m/s, reached at 1 m/s2; yields after each step."""
    for step in range(round(seconds / plant.step_size)):
        t = step * plant.step_size
        pitch, rate, v = (plant.read(f"truth.{name}") for name in ("pitch", "pitch_rate", "linear_velocity"))
        hold = -0.5 * (LAW[0] * pitch + LAW[1] * rate + LAW[2] * (v - min(speed, t)))
        left, right = drive(t)
        plant.step((hold + left, hold + right))
        yield plant


def _run(plant: Plant, seconds: float, drive: Drive = _rest, speed: float = 0.0) -> Plant:
    for _ in _held(plant, seconds, drive, speed):
        pass
    return plant


def _spin(plant: Plant, seconds: float, torque: float) -> Plant:
    for _ in range(round(seconds / plant.step_size)):
        plant.step((torque, torque))
    return plant


@pytest.mark.parametrize(("slope", "payload", "push"), [(0.0, 0.0, 0.0), (0.1, 1.5, 0.0), (0.0, 0.0, 6.0)])
def test_where_tyres_grip_it_moves_as_the_plant_that_cannot_slip(slope: float, payload: float, push: float) -> None:
    ours, theirs = _started(0.1), SegwayTorquePlant({**PERFECT, "InitialPitch": 0.1})
    theirs.initialize((0.0, 0.0))
    for plant in (ours, theirs):
        for name, value in (("Slope", slope), ("Payload", payload), ("PushForce", push)):
            plant.write(name, value)
    drive = _rest if slope else _weave  # its slope lies along x, the other one's ahead of the robot
    pairs = zip(_held(ours, 1.5, drive), _held(theirs, 1.5, drive), strict=True)
    for one, other in pairs:
        for name, most in (("pitch", 0.006), ("linear_velocity", 0.03), ("heading", 0.03), ("x", 0.015), ("y", 0.015)):
            assert one.read(f"truth.{name}") == pytest.approx(other.read(f"truth.{name}"), abs=most), name


def test_the_same_seed_gives_the_same_bits() -> None:
    runs = [_run(SegwayContactTorquePlant({"Seed": 3.0}), 0.0) for _ in range(2)]
    for plant in runs:
        plant.initialize((0.0, 0.0))
    assert list(_run(runs[0], 0.5, _weave).step((0.1, 0.2))) == list(_run(runs[1], 0.5, _weave).step((0.1, 0.2)))


@pytest.mark.parametrize("friction", [0.05, 0.3, 0.8])
def test_more_torque_than_a_tyre_carries_makes_it_slide(friction: float) -> None:
    """Coulomb: the ground pushes with friction times load, however fast the wheels spin."""
    plant = _started(friction=friction)
    _spin(plant, 0.03, 1.7)
    rolled = PUBLISHED.wheel_radius * plant.read("left.velocity")
    assert rolled > 2.0 * plant.read("truth.linear_velocity") > 0.0
    gained = (PUBLISHED.body_mass + 2.0 * PUBLISHED.wheel_mass) * plant.read("truth.linear_velocity")
    thrown = PUBLISHED.body_mass * PUBLISHED.body_height_of_centre * plant.read("truth.pitch_rate")
    assert gained + thrown == pytest.approx(0.03 * friction * WEIGHT, rel=0.1)


def test_a_push_that_has_ended_pushes_no_more() -> None:
    plant = _started(0.5)
    plant.write("PushForce", 20.0)
    _spin(plant, 0.1, 0.0)
    plant.write("PushForce", 0.0)
    _spin(plant, 0.1, 0.0)
    speed = plant.read("truth.linear_velocity")
    _spin(plant, 0.3, 0.0)
    assert abs(plant.read("truth.linear_velocity")) <= abs(speed)


def test_each_wheel_has_its_own_friction() -> None:
    plant = _started()
    plant.write("LeftFriction", 0.05)
    _spin(plant, 0.1, 1.0)
    assert plant.read("left.velocity") > 2.0 * plant.read("right.velocity")
    assert plant.read("truth.heading") > 0.01


def test_on_ice_its_wheels_carry_no_more_than_ice_does() -> None:
    plant = _started(IceAt=-1.0, IceLength=2.0, IceFriction=0.1)
    _spin(plant, 0.05, 1.0)
    assert plant.read("left.velocity") * PUBLISHED.wheel_radius > 3.0 * plant.read("truth.linear_velocity")


@pytest.mark.parametrize(("side", "sign"), [(0.0, 0.0), (1.0, 1.0), (-1.0, -1.0)])
def test_a_kerb_lifts_the_wheels_in_whose_way_it_lies(side: float, sign: float) -> None:
    plant = _started(KerbAt=0.3, KerbHeight=0.01, KerbSide=side)
    heights = [plant.body.wheel_heights() for _ in _held(plant, 1.5, speed=0.8)]
    left, right = heights[-1]
    assert plant.read("truth.x") > 0.4
    assert (left > 0.008, right > 0.008) == (sign >= 0.0, sign <= 0.0)


def test_off_a_drop_it_falls_by_its_height() -> None:
    plant = _started(KerbAt=0.2, KerbHeight=-0.02)
    assert plant.body.wheel_heights() == pytest.approx((0.02, 0.02), abs=1e-3)
    loads = [plant.body.loads for _ in _held(plant, 1.5, speed=0.6)]
    assert plant.body.wheel_heights() == pytest.approx((0.0, 0.0), abs=2e-3)
    assert (0.0, 0.0) in loads, "it was in the air"
    assert max(loads)[0] > WEIGHT, "and landed"


def test_up_a_ramp_it_gains_height_and_downhill_loses_it() -> None:
    for angle in (0.1, -0.1):
        plant = _started(RampAt=0.2, RampLength=0.5, RampAngle=angle)
        _run(plant, 2.0, speed=0.8)
        assert plant.body.wheel_heights()[0] == pytest.approx(0.5 * math.sin(angle), abs=3e-3)


def test_gravel_shakes_it_as_its_seed_lays_it() -> None:
    def shaken(seed: float) -> list[float]:
        plant = _started(GravelAt=0.1, GravelLength=1.0, GravelHeight=0.005, Seed=seed)
        return [plant.body.wheel_heights()[0] for _ in _held(plant, 1.0, speed=0.5)]

    one, same, other = shaken(1.0), shaken(1.0), shaken(2.0)
    assert one == same != other
    assert 0.001 < max(one) < 0.006


def test_lifted_by_hand_it_carries_nothing_and_set_down_again_its_weight() -> None:
    plant = _started(0.5)
    plant.write("Lift", 0.3)
    _spin(plant, 2.0, 0.0)
    assert plant.body.loads == (0.0, 0.0)
    assert min(plant.body.wheel_heights()) > 0.1
    plant.write("Lift", 0.0)
    _spin(plant, 2.0, 0.0)
    assert sum(plant.body.loads) > 0.4 * WEIGHT
    assert abs(plant.read("truth.pitch")) == pytest.approx(PUBLISHED.stop_angle, abs=0.02)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_it_falls_onto_its_bumper_and_lies_there(sign: float) -> None:
    plant = _spin(_started(0.05 * sign), 3.0, 0.0)
    assert plant.read("truth.pitch") == pytest.approx(sign * PUBLISHED.stop_angle, abs=0.01)
    assert abs(plant.read("truth.pitch_rate")) < 0.02


def test_with_backlash_the_rotor_turns_before_the_wheel() -> None:
    plain, loose = _started(), _started(Backlash=math.radians(0.5))
    for plant in (plain, loose):
        _spin(plant, 0.03, 0.2)
        _spin(plant, 0.004, -0.2)
    assert loose.read("left.velocity") < plain.read("left.velocity") - 0.5


def test_cogging_drag_and_vibration_are_felt() -> None:
    smooth = _run(_started(), 1.0, speed=0.5)
    dragged = _run(_started(CableDrag=3.0), 1.0, speed=0.5)
    assert dragged.read("truth.linear_velocity") < smooth.read("truth.linear_velocity") - 0.05
    cogging = _run(_started(Cogging=0.05), 1.0, speed=0.5)
    assert cogging.read("truth.linear_velocity") != smooth.read("truth.linear_velocity")
    quiet, shaken = (
        [p.read("imu.linear_acceleration_z") for p in _held(_started(ImuVibration=most), 0.5, speed=0.5)][100:]
        for most in (0.0, 20.0)
    )
    assert max(shaken) - min(shaken) > max(quiet) - min(quiet) + 0.5


def test_a_drop_for_one_wheel_is_refused() -> None:
    with pytest.raises(ModelError, match="KerbSide"):
        SegwayContactTorquePlant({"KerbHeight": -0.02, "KerbSide": 1.0}).initialize((0.0, 0.0))


def test_its_ports_are_those_of_the_plant_that_cannot_slip() -> None:
    for contact, plain in ((SegwayContactTorquePlant, SegwayTorquePlant), (SegwayContactPlant, SegwayPlant)):
        assert (contact.inputs, contact.outputs, contact.step_size) == (plain.inputs, plain.outputs, plain.step_size)
        assert {v.name for v in plain.states} <= {v.name for v in contact.states}
        assert {v.name for v in plain.parameters} <= {v.name for v in contact.parameters}


def test_a_payload_below_zero_is_refused_and_not_taken_for_none() -> None:
    with pytest.raises(ModelError, match="Payload"):
        _started().write("Payload", -1.0)
