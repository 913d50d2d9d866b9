# SPDX-License-Identifier: MIT
"""Gain, offset and mixing between the ports of a model and the robot's signals."""

import math

import msgspec
import pytest

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.mixing import (
    DifferentialMixing,
    GeometrySection,
    WiredSignal,
    controller_mixers,
    plant_mixers,
)
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.sources import Origin, SignalSource
from segway_ecc.node.cycle.wiring import wire
from segway_ecc.node.errors import ConfigurationError, UnknownNameError
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import SectionedModel
from segway_ecc.testing import RecordingHardware

AXES = ("front_left", "front_right", "rear_left", "rear_right")
MIXING = {"base": DifferentialMixing(left=("front_left", "rear_left"), right=("front_right", "rear_right"))}
GEOMETRY = GeometrySection(wheel_radius=0.1, track=0.5)
MIXERS = controller_mixers(MIXING, GEOMETRY)


class Body(SectionedModel):
    name = "body"
    step_size = 0.01
    inputs = (Variable("Speed", "m/s"), Variable("YawRate", "rad/s"))
    outputs = (Variable("Force", "N"), Variable("Moment", "N m"), Variable("X", "m"))
    states = (Variable("Wanted", "m/s", 3.0, Write.NOW, minimum=-1.0, maximum=5.0),)


WIRING: dict[str, str | WiredSignal] = {
    "Speed": "base.linear_velocity",
    "YawRate": "base.angular_velocity",
    "Force": "base.force",
    "Moment": "base.moment",
}


@pytest.fixture
def hardware() -> RecordingHardware:
    signals = {f"{axis}.{value}": unit for axis in AXES for value, unit in (("angle", "rad"), ("velocity", "rad/s"))}
    return RecordingHardware(signals, {f"{axis}.torque": "N m" for axis in AXES}, (5.0,) * 4)


def measured(velocities: dict[str, float]) -> Sensors:
    values = [value for axis in AXES for value in (0.0, velocities[axis])]
    return Sensors(tuple(values), (0.0,) * 8, (True,) * 8)


def test_a_robot_moves_as_the_mean_and_turns_as_the_difference_of_its_sides(hardware: RecordingHardware) -> None:
    wiring = wire(Body(), hardware, WIRING, mixers=MIXERS)
    sensors = measured({"front_left": 9.0, "rear_left": 11.0, "front_right": 20.0, "rear_right": 20.0})
    assert wiring.model_inputs(sensors, Setpoint(0.0, 0.0), ()) == pytest.approx([1.5, 2.0])
    assert wiring.sensors == (1, 3, 5, 7), "it depends on every wheel"


def test_the_wheels_give_the_power_of_force_and_moment(hardware: RecordingHardware) -> None:
    wiring = wire(Body(), hardware, WIRING, mixers=MIXERS)
    force, moment = 12.0, -1.0
    torques = wiring.commands([force, moment, 0.0])
    assert torques == pytest.approx([0.4, 0.2, 0.4, 0.2])
    velocities = dict(zip(AXES, (7.0, -4.0, 7.0, -4.0), strict=True))
    speed, yaw_rate = wiring.model_inputs(measured(velocities), Setpoint(0.0, 0.0), ())
    power = sum(torque * velocities[axis] for axis, torque in zip(AXES, torques, strict=True))
    assert power == pytest.approx(force * speed + moment * yaw_rate)


def test_the_wheels_of_a_pair_are_watched_together(hardware: RecordingHardware) -> None:
    wiring = wire(Body(), hardware, WIRING, mixers=MIXERS)
    assert list(wiring.wheels) == [("front_left", "front_right"), ("rear_left", "rear_right")]


def test_what_is_given_to_a_wheel_is_limited_by_its_name(hardware: RecordingHardware) -> None:
    wiring = wire(Body(), hardware, WIRING, mixers=MIXERS)
    given = wiring.given["rear_right.torque"]
    assert given.unit == "N m"
    assert wiring.with_sums([12.0, -1.0, 0.0])[given.place] == pytest.approx(0.2)


def test_setpoints_are_mixed_to_the_sides(hardware: RecordingHardware) -> None:
    sides: dict[str, str | WiredSignal] = {"Speed": "base.left_setpoint", "YawRate": "base.right_setpoint"}
    wiring = wire(Body(), hardware, WIRING | sides, mixers=MIXERS)
    assert wiring.model_inputs(measured(dict.fromkeys(AXES, 0.0)), Setpoint(1.0, 2.0), ()) == pytest.approx([5.0, 15.0])
    assert wiring.sensors == ()


def test_one_torque_goes_to_each_wheel_of_a_side(hardware: RecordingHardware) -> None:
    sides: dict[str, str | WiredSignal] = {"Force": "base.left_torque", "Moment": "base.right_torque"}
    assert wire(Body(), hardware, WIRING | sides, mixers=MIXERS).commands([1.5, -2.5, 0.0]) == [1.5, -2.5, 1.5, -2.5]


def test_what_a_plant_is_given_and_gives_is_the_inverse() -> None:
    (of_controller,), (of_plant,) = MIXERS, plant_mixers(MIXING, GEOMETRY)
    for value in ("linear_velocity", "angular_velocity"):
        for other in ("linear_velocity", "angular_velocity"):
            wheels = of_plant.gives[f"base.{other}"].factors
            back = of_controller.takes[f"base.{value}"].factors
            assert sum(back[name] * wheels[name] for name in back) == pytest.approx(float(value == other))
    for value in ("force", "moment"):
        for other in ("force", "moment"):
            torques = of_controller.gives[f"base.{other}"].factors
            back = of_plant.takes[f"base.{value}"].factors
            assert sum(back[name] * torques[name] for name in back) == pytest.approx(float(value == other))


def test_gain_and_offset_act_where_the_value_arrives(hardware: RecordingHardware) -> None:
    scaled: dict[str, str | WiredSignal] = {
        "Speed": WiredSignal(signal="front_left.velocity", gain=0.5, offset=1.0),
        "YawRate": "valid.rear_left.velocity",
        "Wanted": WiredSignal(signal="set.wanted", gain=-2.0, offset=1.0),
        "Force": WiredSignal(signal="base.left_torque", gain=2.0, offset=0.25),
        "Moment": "base.right_torque",
        "X": WiredSignal(signal="odometry.x", gain=0.001),
    }
    wiring = wire(Body(), hardware, scaled, mixers=MIXERS)
    sensors = measured({"front_left": 9.0, "rear_left": 11.0, "front_right": 20.0, "rear_right": 20.0})
    assert wiring.model_inputs(sensors, Setpoint(0.0, 0.0), (0.0,)) == [5.5, 1.0]
    assert wiring.commands([1.0, 3.0, 0.0]) == [2.25, 3.0, 2.25, 3.0]
    published = dict(zip(wiring.published, wiring.publish(sensors, [1.0, 3.0, 500.0]), strict=True))
    assert published["odometry.x"] == 0.5
    # What is set is what the state has, and its range, seen through gain and offset.
    assert (wiring.set_values, list(wiring.set_ranges)) == ((-1.0,), [(-2.0, 1.0)])
    assert wiring.state_writes(Setpoint(0.0, 0.0), (-1.0,)) == [("Wanted", 3.0)]
    assert wiring.writes_of(0, 0.5) == [("Wanted", 0.0)]


def test_a_plain_entry_is_a_place_and_nothing_is_computed(hardware: RecordingHardware) -> None:
    plain: dict[str, str | WiredSignal] = {
        "Speed": WiredSignal(signal="front_left.velocity"),
        "YawRate": "rear_left.velocity",
        "Force": "base.left_torque",
        "Moment": "base.right_torque",
    }
    wiring = wire(Body(), hardware, plain, mixers=MIXERS)
    assert wiring.inputs == (SignalSource(Origin.SENSOR, 1), SignalSource(Origin.SENSOR, 5))
    assert (wiring.input_sums, wiring.state_sums, wiring.output_sums) == ((), (), ())
    y = [1.0, 2.0, 3.0]
    assert wiring.with_sums(y) is y


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"Moment": "base.force"}, "wiring: 'Force' and 'Moment' both drive 'base.force'; keep one"),
        ({"Moment": "front_left.torque"}, "wiring: 'Force' and 'Moment' both drive 'front_left.torque'; keep one"),
        ({"X": "front_left.torque"}, "wiring: 'Force' and 'X' both drive 'front_left.torque'; keep one"),
        ({"X": WiredSignal(signal="topic.x", gain=2.0)}, "'X' is published on topic.x as it is"),
    ],
)
def test_what_cannot_be_is_refused(
    hardware: RecordingHardware, changes: dict[str, str | WiredSignal], message: str
) -> None:
    with pytest.raises(ConfigurationError, match=message):
        wire(Body(), hardware, WIRING | changes, mixers=MIXERS)


def test_a_mixing_of_axes_that_are_not_there_is_refused(hardware: RecordingHardware) -> None:
    mixers = controller_mixers({"base": DifferentialMixing()}, GEOMETRY)
    with pytest.raises(UnknownNameError, match=r"left\.velocity"):
        wire(Body(), hardware, WIRING, mixers=mixers)


@pytest.mark.parametrize("changes", [{"gain": 0.0}, {"gain": math.inf}, {"offset": math.nan}])
def test_a_gain_of_nothing_and_what_is_no_number_is_refused(changes: dict[str, float]) -> None:
    with pytest.raises(msgspec.ValidationError, match="both must be finite, and gain not zero"):
        msgspec.convert({"signal": "left.velocity", **changes}, WiredSignal)


@pytest.mark.parametrize("geometry", [GeometrySection(), GeometrySection(track=0.5), GeometrySection(wheel_radius=0.1)])
def test_a_mixing_without_its_lengths_is_refused(geometry: GeometrySection) -> None:
    with pytest.raises(ConfigurationError, match=r"mixing\.base needs geometry\.wheel_radius and geometry\.track"):
        controller_mixers(MIXING, geometry)
