# SPDX-License-Identifier: MIT
"""A plant wired like a controller: by names, gain, offset and mixing."""

import pytest

from segway_ecc.hil.plants.skid_steer import SkidSteerPlant
from segway_ecc.hil.rig.wired_plant import WiredPlant
from segway_ecc.node.cycle.mixing import DifferentialMixing, GeometrySection, WiredSignal, plant_mixers
from segway_ecc.node.errors import ConfigurationError, UnknownNameError
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import SectionedModel

GEOMETRY = GeometrySection(wheel_radius=0.1, track=0.5)
MIXERS = plant_mixers({"base": DifferentialMixing()}, GEOMETRY)


class Motor(SectionedModel):
    """As 20-sim would export it: in its own names, units and turns."""

    name = "motor"
    step_size = 0.001
    inputs = (Variable("torque_in", "mN m"),)
    outputs = (Variable("position", "deg"), Variable("speed", "rpm"), Variable("heat", "W"))

    def input(self, u: object) -> None:
        self.taken = u

    def output(self) -> tuple[float, ...]:
        return (90.0, 60.0, float(self.taken[0]))  # type: ignore[index]


def test_a_plant_takes_and_gives_in_its_own_names_and_units() -> None:
    plant = WiredPlant(
        Motor(),
        {
            "torque_in": WiredSignal(signal="pan.torque", gain=1000.0),
            "position": WiredSignal(signal="pan.angle", gain=0.01, offset=-0.5),
            "speed": "pan.velocity",
        },
    )
    assert [v.name for v in plant.inputs] == ["pan.torque"]
    assert [v.name for v in plant.outputs] == ["pan.angle", "pan.velocity", "heat"]
    assert plant.initialize([0.25]) == pytest.approx([0.4, 60.0, 250.0])
    assert plant.step([0.5]) == pytest.approx([0.4, 60.0, 500.0])
    assert plant.read("heat") == 500.0


def test_wheels_are_mixed_to_a_body_and_back() -> None:
    names = {
        "Force": "base.force",
        "Moment": "base.moment",
        "Speed": "base.linear_velocity",
        "YawRate": "base.angular_velocity",
    }
    plant = WiredPlant(SkidSteerPlant(), {**names, "Way": "base.distance", "Turn": "base.rotation"}, MIXERS)
    assert [v.name for v in plant.inputs] == ["left.torque", "right.torque"]
    own = SkidSteerPlant()
    own.initialize([0.0, 0.0])
    plant.initialize([0.0, 0.0])
    for _ in range(500):
        found = dict(zip([v.name for v in plant.outputs], plant.step([0.4, 0.7]), strict=True))
        # The torques over the radius, and their difference times half of the track over it.
        speed, yaw_rate, way, turn, *_ = own.step([11.0, 0.75])
    assert found["left.velocity"] == pytest.approx((speed - 0.25 * yaw_rate) / 0.1)
    assert found["right.velocity"] == pytest.approx((speed + 0.25 * yaw_rate) / 0.1)
    assert found["left.angle"] == pytest.approx((way - 0.25 * turn) / 0.1)
    assert found["right.angle"] == pytest.approx((way + 0.25 * turn) / 0.1)
    assert found["truth.heading"] == pytest.approx(turn)
    assert speed > 0.1
    assert turn > 0.01


def test_several_steps_at_once_are_those_one_by_one() -> None:
    names = {
        "Force": "base.force",
        "Moment": "base.moment",
        "Speed": "base.linear_velocity",
        "YawRate": "base.angular_velocity",
    }
    one, other = (WiredPlant(SkidSteerPlant(), names, MIXERS) for _ in range(2))
    one.initialize([0.0, 0.0])
    other.initialize([0.0, 0.0])
    assert one.advance([1.0, 2.0], 5) == [other.step([1.0, 2.0]) for _ in range(5)][-1]


def test_a_port_that_is_not_there_is_named() -> None:
    with pytest.raises(UnknownNameError, match=r"port of plant 'motor' in simulation\.wiring"):
        WiredPlant(Motor(), {"torque": "pan.torque"})


def test_two_outputs_of_one_name_are_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"simulation\.wiring: 'position' and 'speed' both drive 'pan\.angle'"):
        WiredPlant(Motor(), {"position": "pan.angle", "speed": "pan.angle"})
