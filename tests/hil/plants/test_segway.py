# SPDX-License-Identifier: MIT
"""The segway's plants as a rig uses them."""

import math
from collections.abc import Sequence

import pytest

from segway_ecc.hil.plants.segway import SegwayPlant, SegwayTorquePlant
from segway_ecc.node.errors import ModelError
from segway_ecc.node.models.segway_parameters import PUBLISHED

PLANTS = (SegwayTorquePlant, SegwayPlant)
Plant = type[SegwayTorquePlant | SegwayPlant]
REST = (0.0, 0.0)
PERFECT = {"SensorErrors": 0.0}
IMU = [f"imu.{kind}_{axis}" for kind in ("angular_velocity", "linear_acceleration") for axis in "xyz"]


def _names(values: Sequence[float], plant: SegwayTorquePlant | SegwayPlant) -> dict[str, float]:
    return dict(zip((v.name for v in plant.outputs), values, strict=True))


def _run(plant: SegwayTorquePlant | SegwayPlant, seconds: float, inputs: Sequence[float] = REST) -> dict[str, float]:
    outputs: Sequence[float] = ()
    for _ in range(round(seconds / plant.step_size)):
        outputs = plant.step(inputs)
    return _names(outputs, plant)


def _started(cls: Plant, **parameters: float) -> SegwayTorquePlant | SegwayPlant:
    plant = cls({**PERFECT, **parameters})
    plant.initialize(REST)
    return plant


@pytest.mark.parametrize(("cls", "unit"), [(SegwayTorquePlant, "torque"), (SegwayPlant, "voltage")])
def test_has_the_ports_that_all_agreed_on(cls: Plant, unit: str) -> None:
    assert [v.name for v in cls.inputs] == [f"left.{unit}", f"right.{unit}"]
    wheels = ["left.angle", "left.velocity", "right.angle", "right.velocity"]
    truth = ("x", "y", "heading", "linear_velocity", "angular_velocity", "pitch", "pitch_rate", "supply_voltage")
    assert [v.name for v in cls.outputs] == [*wheels, *IMU, *(f"truth.{name}" for name in truth)]
    assert [v.name for v in cls.states] == ["PushForce", "Slope", "Payload"]
    assert cls.step_size == 0.001


@pytest.mark.parametrize("cls", PLANTS)
def test_upright_it_stays(cls: Plant) -> None:
    end = _run(_started(cls), 2.0)
    moving = {name: value for name, value in end.items() if value}
    assert moving == {"imu.linear_acceleration_z": 9.80665, "truth.supply_voltage": 18.0}


@pytest.mark.parametrize("cls", PLANTS)
@pytest.mark.parametrize("sign", [1, -1])
def test_falls_and_lies(cls: Plant, sign: int) -> None:
    end = _run(_started(cls, InitialPitch=0.05 * sign), 4.0)
    assert end["truth.pitch"] == pytest.approx(0.5 * sign)
    assert end["truth.pitch_rate"] == 0.0
    assert end["truth.linear_velocity"] == pytest.approx(0.0, abs=1e-3)
    assert end["imu.linear_acceleration_x"] == pytest.approx(-9.80665 * math.sin(0.5 * sign), abs=1e-2)


@pytest.mark.parametrize("cls", PLANTS)
def test_torque_ahead_leans_it_back_and_rolls_it_on(cls: Plant) -> None:
    end = _run(_started(cls), 0.1, (0.5, 0.5))
    assert end["truth.linear_velocity"] > 0.0
    assert end["truth.pitch"] < 0.0
    assert end["truth.x"] > 0.0
    assert end["left.angle"] == end["right.angle"] == pytest.approx(end["truth.x"] / 0.05 - end["truth.pitch"])


@pytest.mark.parametrize("cls", PLANTS)
def test_more_on_the_right_turns_left(cls: Plant) -> None:
    end = _run(_started(cls, InitialPitch=0.5), 0.5, (0.1, 0.3))
    assert end["truth.heading"] > 0.0
    assert end["truth.y"] > 0.0
    assert end["right.velocity"] > end["left.velocity"]


def test_drives_a_circle() -> None:
    """Upright and without friction nothing changes its speeds, and the circle's radius is v / w."""
    plant = _started(SegwayTorquePlant, ViscousFriction=0.0, CoulombFriction=0.0)
    plant.body.v, plant.body.w = 1.0, 2.0
    outputs = _run(plant, 2.0)
    assert outputs["truth.heading"] == pytest.approx(4.0)
    assert outputs["truth.x"] == pytest.approx(0.5 * math.sin(4.0), abs=1e-5)
    assert outputs["truth.y"] == pytest.approx(0.5 * (1 - math.cos(4.0)), abs=1e-5)


@pytest.mark.parametrize(
    ("name", "value", "pitches"),
    [("PushForce", 5.0, 1), ("PushForce", -5.0, -1), ("Slope", 0.05, 1), ("Slope", -0.05, -1)],
)
def test_is_disturbed_while_it_runs(name: str, value: float, pitches: int) -> None:
    """A push ahead topples it forwards; ground that rises ahead lets its wheels roll back from under it."""
    plant = _started(SegwayTorquePlant)
    _run(plant, 0.1)
    plant.write(name, value)
    assert plant.read(name) == value
    assert _run(plant, 0.3)["truth.pitch"] * pitches > 0.01
    plant.initialize(REST)
    assert plant.read(name) == 0.0
    assert _run(plant, 0.3)["truth.pitch"] == 0.0


@pytest.mark.parametrize(("payload", "height"), [(0.0, 0.5), (3.0, 0.2), (3.0, 0.9)])
def test_a_payload_counts_at_its_height(payload: float, height: float) -> None:
    """It falls as pitch0 cosh(k t) with k^2 = S g M / (M J - S^2), S and J the body's and the payload's moments."""
    frictionless = {"CoulombFriction": 0.0, "ViscousFriction": 0.0}
    plant = _started(SegwayTorquePlant, InitialPitch=1e-6, PayloadHeight=height, **frictionless)
    plant.write("Payload", payload)
    first = 4.966 * 0.2811 + payload * height
    second = 4.966 * 0.2811**2 + 0.1095 + payload * height**2
    mass = 4.966 + payload + 2 * (0.1826 + 1.723e-4 / 0.05**2)
    k = math.sqrt(first * 9.80665 * mass / (mass * second - first**2))
    assert _run(plant, 0.4)["truth.pitch"] == pytest.approx(1e-6 * math.cosh(0.4 * k), rel=1e-4)


def test_parameters_are_taken_at_the_next_start() -> None:
    plant = _started(SegwayTorquePlant)
    plant.write("InitialPitch", 0.2)
    assert _run(plant, 0.01)["truth.pitch"] == 0.0
    assert _names(plant.initialize(REST), plant)["truth.pitch"] == 0.2
    with pytest.raises(ModelError, match="only finite"):
        plant.write("Slope", math.nan)


@pytest.mark.parametrize("cls", PLANTS)
def test_the_supply_sags_while_it_drives(cls: Plant) -> None:
    """Stalled (a wheel turns slowly at first), 1 N m takes (1 / 0.0251)^2 0.075 W in each motor."""
    plant = _started(cls, InitialPitch=0.5)
    inputs = (1.0, 1.0) if cls is SegwayTorquePlant else (1.0 / 0.0251 * 0.075,) * 2
    sagging = _run(plant, 0.01, inputs)["truth.supply_voltage"]
    power = 2 * (1 / 0.0251) ** 2 * 0.075
    assert sagging == pytest.approx(9.0 + math.sqrt(81.0 - 0.1 * power), abs=0.1)
    assert _run(plant, 0.01)["truth.supply_voltage"] == pytest.approx(18.0, abs=0.05)


def test_a_weak_battery_gives_less_torque() -> None:
    strong, weak = (
        _run(_started(SegwayPlant, InitialPitch=0.5, SupplyVoltage=volts), 0.1, (12.0, 12.0)) for volts in (18.0, 3.0)
    )
    assert weak["truth.linear_velocity"] < 0.7 * strong["truth.linear_velocity"]


def test_perfect_sensors_measure_the_truth() -> None:
    end = _run(_started(SegwayTorquePlant, InitialPitch=0.02), 0.4, (0.1, 0.15))
    assert end["imu.angular_velocity_y"] == end["truth.pitch_rate"]
    assert end["imu.angular_velocity_z"] == pytest.approx(end["truth.angular_velocity"] * math.cos(end["truth.pitch"]))
    both = 0.5 * (end["left.velocity"] + end["right.velocity"]) + end["truth.pitch_rate"]
    assert both * PUBLISHED.wheel_radius == pytest.approx(end["truth.linear_velocity"])


def test_sensors_are_off_by_their_errors_which_the_seed_decides() -> None:
    def seen(**parameters: float) -> list[float]:
        plant = SegwayTorquePlant({"InitialPitch": 0.02, **parameters})
        plant.initialize(REST)
        return [value for _ in range(40) for value in plant.step(REST)]

    assert seen() == seen()
    assert seen() != seen(Seed=2.0)
    assert seen() != seen(**PERFECT)


def test_errors_change_nothing_of_what_really_happens() -> None:
    noisy, perfect = (SegwayTorquePlant({"InitialPitch": 0.02, "SensorErrors": e}) for e in (1.0, 0.0))
    for plant in (noisy, perfect):
        plant.initialize(REST)
    ends = [_run(plant, 0.3, (0.1, 0.2)) for plant in (noisy, perfect)]
    truths = [{name: value for name, value in end.items() if name.startswith("truth.")} for end in ends]
    assert truths[0] == truths[1]
    assert ends[0]["imu.linear_acceleration_x"] != ends[1]["imu.linear_acceleration_x"]
    assert ends[0]["left.angle"] == pytest.approx(ends[1]["left.angle"], abs=2 * math.pi / 16384)


def test_sensor_errors_scale() -> None:
    still = []
    for share in (1.0, 3.0):
        plant = SegwayTorquePlant({"SensorErrors": share, "ImuLatency": 0.0})
        plant.initialize(REST)
        still.append(plant.step(REST)[4])
    assert still[1] == pytest.approx(3.0 * still[0])


def test_the_imu_is_late() -> None:
    exact = {v.name: 0.0 for v in SegwayTorquePlant.parameters if v.name.startswith(("Gyro", "Accelerometer"))}
    plant = SegwayTorquePlant({**exact, "InitialPitch": 0.1, "ImuLatency": 0.01})
    plant.initialize(REST)
    steps = [_names(plant.step(REST), plant) for _ in range(40)]
    measured = [step["imu.angular_velocity_y"] for step in steps]
    assert measured == [0.0] * 10 + [step["truth.pitch_rate"] for step in steps[:-10]]


def test_starts_again_as_it_started() -> None:
    plant = SegwayPlant({"InitialPitch": 0.1})
    runs = []
    for _ in range(2):
        plant.initialize(REST)
        runs.append([plant.step((1.0, 0.5)) for _ in range(50)])
    assert runs[0] == runs[1]


def test_lying_down_and_getting_up_again() -> None:
    """A law of proportional feedback gets it off its bumper and holds it."""
    plant = _started(SegwayTorquePlant, InitialPitch=0.5)
    end = _run(plant, 0.5)
    for _ in range(2000):
        both = 22.0 * end["truth.pitch"] + 3.0 * end["truth.pitch_rate"] + 0.7 * end["truth.linear_velocity"]
        end = _names(plant.step((0.5 * both, 0.5 * both)), plant)
    assert end["truth.pitch"] == pytest.approx(0.0, abs=0.02)
