# SPDX-License-Identifier: MIT
"""What the robot that balances is made of: one table for its plant and for whoever designs its controller.

Source of the published values: Upkie, an open-source wheeled biped (Apache 2.0), from the file urdf/upkie.urdf of
https://github.com/upkie/upkie_description at commit 0683d055 ("URDF" below), with both legs straight and locked. Its
links were added up by the parallel-axis theorem: those on the torso, the legs and the motors' stators to the body; the
motor's rotor, hub and tyre to the wheel. What is not in that file is marked:

- derived: follows from published values by a formula that is given.
- third party: a value for the same motor from somebody else's table.
- assumed: chosen by us as typical of such parts; no measurement stands behind it.

Two liberties. The URDF's centre of mass lies 6 mm behind the axle's plumb line: pitch is counted here from where the
robot balances, which turns the body's frame by 1.3 degrees. The product of inertia that is left, 0.0017 kg m2, is left
out, and so is what the URDF gives the femur and tibia (a length of 0.026 m entered for 0.26 m): 0.056 kg rods of that
length, 3.2e-4 kg m2 each, stand in their place.

Frames are those of REP-103; pitch is positive when the body leans forward. Everything is SI.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Final, Self

from segway_ecc.node.model.model import Variable, Write


def _published(value: float, unit: str, minimum: float, maximum: float) -> float:
    """A field with its unit, and a range that any robot of this kind is in: a value beyond it is a mistake."""
    made: float = field(default=value, metadata={"unit": unit, "minimum": minimum, "maximum": maximum})
    return made


@dataclass(frozen=True, slots=True, kw_only=True)
class SegwayParameters:
    """A body on two driven wheels, by default the published one. Every field has its SI unit and its range as metadata.

    Attributes:
        gravity: Gravity, m/s2.
        body_mass: All but the wheels, kg.
        body_height_of_centre: From the axle up to the body's centre of mass, m.
        body_pitch_inertia: Body about its centre of mass and the axis along the axle, kg m2.
        body_roll_inertia: The same about the body's axis that points ahead when upright.
        body_yaw_inertia: The same about the body's axis that points up when upright.
        wheel_radius: Rolling radius, m.
        wheel_mass: One wheel with what turns with it, kg.
        wheel_inertia: One wheel with its rotor about the axle, kg m2; a geared rotor counts times the ratio squared.
        wheel_diameter_inertia: One wheel about a diameter, kg m2.
        track: Between the two wheels' contacts, m.
        viscous_friction: In one wheel's bearing, between wheel and body, N m s.
        coulomb_friction: The same, independent of speed, N m.
        coulomb_speed: Speed at which the Coulomb friction reaches 76 %, rad/s: it follows tanh(speed / coulomb_speed).
        motor_resistance: Of the equivalent DC motor, Ohm.
        motor_inductance: Of the equivalent DC motor, H.
        motor_constant: N m/A at the motor's shaft, and V s of back-EMF.
        gear_ratio: Turns of the motor per turn of the wheel.
        torque_limit: What the drive lets one wheel have, N m at the wheel.
        torque_time_constant: First-order lag of the drive's torque loop, s.
        supply_voltage: Battery without load, V.
        supply_resistance: Battery and wiring, Ohm.
        encoder_counts_per_turn: Per turn of the wheel; 0 for an encoder without steps.
        encoder_filter_time: Of the first-order filter that makes speed of counts, s.
        imu_height: From the axle up to the IMU, m, in the plane through axle and centre of mass.
        stop_angle: Lean against the ground's normal at which the body's bumpers touch the ground, rad.
    """

    gravity: float = _published(9.80665, "m/s2", 0.1, 30.0)  # standard gravity
    body_mass: float = _published(4.966, "kg", 0.1, 500.0)  # URDF, sum
    body_height_of_centre: float = _published(0.2811, "m", 0.01, 3.0)  # URDF, sum
    body_pitch_inertia: float = _published(0.1095, "kg m2", 1e-05, 500.0)  # URDF, sum
    body_roll_inertia: float = _published(0.1993, "kg m2", 1e-05, 500.0)  # URDF, sum
    body_yaw_inertia: float = _published(0.0981, "kg m2", 1e-05, 500.0)  # URDF, sum
    wheel_radius: float = _published(0.05, "m", 0.005, 1.0)  # URDF: wheel_tire
    wheel_mass: float = _published(0.1826, "kg", 0.001, 100.0)  # URDF: rotor (called a guess there), hub, tyre
    wheel_inertia: float = _published(1.723e-4, "kg m2", 1e-07, 50.0)  # URDF, sum
    wheel_diameter_inertia: float = _published(1.52e-4, "kg m2", 1e-07, 50.0)  # URDF, sum
    track: float = _published(0.3048, "m", 0.02, 5.0)  # URDF: twice the y of wheel_tire
    viscous_friction: float = _published(1.0e-4, "N m s", 0.0, 10.0)  # assumed
    coulomb_friction: float = _published(0.02, "N m", 0.0, 50.0)  # assumed: 1.2 % of the largest torque
    coulomb_speed: float = _published(0.05, "rad/s", 0.0001, 10.0)  # assumed: makes friction smooth enough to integrate
    # derived: 3/2 of 0.05 Ohm per phase (third party, pypowertrain's table of the mj5208)
    motor_resistance: float = _published(0.075, "Ohm", 0.0001, 100.0)
    motor_inductance: float = _published(4.5e-5, "H", 1e-07, 1.0)  # derived: 3/2 of 30 uH per phase (same table)
    # derived: sqrt(3)/2 * 60 / (2 pi Kv) with Kv = 330 rpm/V (same table)
    motor_constant: float = _published(0.0251, "N m/A", 0.0001, 10.0)
    gear_ratio: float = _published(1.0, "1", 0.01, 1000.0)  # direct drive
    torque_limit: float = _published(1.7, "N m", 0.0, 1000.0)  # URDF: effort of left_wheel
    torque_time_constant: float = _published(1.0e-3, "s", 0.0, 1.0)  # assumed
    supply_voltage: float = _published(18.0, "V", 0.0, 10000.0)  # assumed: five lithium cells
    supply_resistance: float = _published(0.1, "Ohm", 0.0, 100.0)  # assumed
    encoder_counts_per_turn: float = _published(16384.0, "1", 0.0, 100000000.0)  # assumed: 14 bits on the motor's shaft
    encoder_filter_time: float = _published(5.0e-3, "s", 0.0, 1.0)  # assumed
    imu_height: float = _published(0.507, "m", -3.0, 3.0)  # URDF: origin of imu over the axle
    stop_angle: float = _published(0.5, "rad", 0.01, 1000.0)  # assumed: bumpers, which the published robot has not

    @classmethod
    def from_model(cls, values: Mapping[str, float]) -> Self:
        """Take the parameters of a model that declares `VARIABLES`, by their names there."""
        return cls(**{f.name: values[model_name(f.name)] for f in fields(cls)})


PUBLISHED: Final = SegwayParameters()


def model_name(field_name: str) -> str:
    """What a field is called as a parameter of a model: `body_mass` is `BodyMass`."""
    return "".join(word.capitalize() for word in field_name.split("_"))


VARIABLES: Final = tuple(
    Variable(
        model_name(f.name),
        f.metadata["unit"],
        getattr(PUBLISHED, f.name),
        Write.STATIC,
        minimum=f.metadata["minimum"],
        maximum=f.metadata["maximum"],
    )
    for f in fields(SegwayParameters)
)
"""The same as parameters of a model, with the published values: `body_mass` is `BodyMass`."""
