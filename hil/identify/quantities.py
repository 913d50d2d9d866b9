# SPDX-License-Identifier: MIT
"""What is identified: each quantity with what is known of it before, as a mean and a standard deviation.

Sizes are identified in the logarithm, so that they stay positive and their deviation is a share. What is known before
is wide; where the runs tell nothing, an interval stays as wide as that, and says so. The resistance of a motor is the
exception: behind voltage drives, masses, inertias and torques can all be larger by one factor without any motion
changing, so one of them has to be known from elsewhere.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from segway_ecc.hil.design.linear_model import Matrix
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.models.segway_parameters import SegwayParameters, model_name

_SIZE: Final = 0.3
_WHEEL: Final = 0.2
"""What is weighed and measured of a wheel gives its inertia that well."""
_FRICTION: Final = 1.0
_VISCOUS: Final = 0.5
"""Narrower: behind voltage drives more of it looks as a larger back-EMF, and a file that had it ten times too small
would have the motor's constant drift with it."""
_RESISTANCE: Final = 0.05
_MEASURED: Final = 0.01
_SMALLEST: Final = 1e-6
"""Of a friction that the file has as zero, N m or N m s: it has a logarithm, and does nothing."""
_SIZES: Final = {
    "body_mass": _SIZE,
    "body_height_of_centre": _SIZE,
    "body_pitch_inertia": _SIZE,
    "body_yaw_inertia": _SIZE,
    "body_roll_inertia": _SIZE,
    "wheel_radius": _SIZE,
    "wheel_inertia": _WHEEL,
    "track": _SIZE,
    "viscous_friction": _VISCOUS,
    "coulomb_friction": _FRICTION,
    "motor_constant": _SIZE,
    "motor_resistance": _RESISTANCE,
}
_MOTOR: Final = frozenset({"motor_constant", "motor_resistance"})


@dataclass(frozen=True, slots=True)
class Quantity:
    """One number that is identified.

    Attributes:
        name: As the plant's parameter is called, where it is one.
        unit: Of its value.
        known: Its value before.
        deviation: Standard deviation of that: a share for a size, else in `unit`.
        least, most: Its range.
        is_size: Whether it is positive and identified in the logarithm.
        is_parameter: Whether the plant has it.
    """

    name: str
    unit: str
    known: float
    deviation: float
    least: float
    most: float
    is_size: bool = False
    is_parameter: bool = False

    def value(self, coordinate: float) -> float:
        """The value at a coordinate, which is its logarithm for a size."""
        return math.exp(coordinate) if self.is_size else coordinate

    @property
    def coordinate(self) -> float:
        """Of what is known before."""
        return math.log(self.known) if self.is_size else self.known

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the coordinate."""
        if not self.is_size:
            return self.least, self.most
        return math.log(max(self.least, _SMALLEST * 1e-3)), math.log(self.most)


def _axes(name: str, unit: str, deviation: float, most: float) -> list[Quantity]:
    return [Quantity(f"{name}{axis}", unit, 0.0, deviation, -most, most) for axis in "XYZ"]


SENSORS: Final = (
    Quantity("Delay", "s", 0.0075, 0.005, 0.0, 0.025),
    Quantity("ImuLatency", "s", 0.0025, 0.005, 0.0, 0.0175),
    Quantity("TyreCreep", "rad/s/(N m)", 0.3, 0.5, -5.0, 5.0),
    Quantity("OffBraking", "1", 0.5, 0.5, 0.0, 1.0),
    *_axes("GyroBias", "rad/s", 0.05, 1.0),
    *_axes("AccelerometerBias", "m/s2", 0.2, 5.0),
    *_axes("Mounting", "rad", 0.1, 0.8),
    Quantity("GyroScale", "1", 1.0, 0.005, 0.8, 1.2),
    Quantity("AccelerometerScale", "1", 1.0, 0.005, 0.8, 1.2),
)
"""What is no parameter of the plant.

Delay: from a cycle's start until its command acts. ImuLatency: by how much the IMU is later than the encoders.
TyreCreep: how much faster a wheel turns than it rolls, per torque. OffBraking: how much of its back-EMF brakes a motor
that is off, from none with open terminals to all with short-circuited ones. Mounting: the IMU's small rotation about
the axes of the body, against the line from axle to centre of mass.
"""


def quantities(
    p: SegwayParameters, *, voltage: bool, measured: Mapping[str, float] | None = None
) -> tuple[Quantity, ...]:
    """What is identified of a robot.

    Args:
        p: What is taken to be known of it.
        voltage: Whether its drives are given a voltage; behind a torque, the motor's constant does not show.
        measured: What was measured otherwise, by name, and is held within 1 %.

    Raises:
        ConfigurationError: There is no such parameter among those that are identified, or its value is out of range.
    """
    found = []
    ranges = {f.name: (f.metadata["unit"], f.metadata["minimum"], f.metadata["maximum"]) for f in dataclasses.fields(p)}
    for name, deviation in _SIZES.items():
        unit, least, most = ranges[name]
        if voltage or name not in _MOTOR:
            known = max(getattr(p, name), _SMALLEST)
            found.append(
                Quantity(model_name(name), unit, known, deviation, least, most, is_size=True, is_parameter=True)
            )
    height = p.imu_height
    found.append(Quantity("ImuHeight", "m", height, _SIZE * abs(height) + 0.03, -3.0, 3.0, is_parameter=True))
    return _held((*found, *SENSORS), measured or {})


def _held(all_of_them: Sequence[Quantity], measured: Mapping[str, float]) -> tuple[Quantity, ...]:
    names = [quantity.name for quantity in all_of_them]
    for name, value in measured.items():
        if name not in names:
            raise ConfigurationError(
                f"--measured {name}: nothing of that name is identified; there is {', '.join(names)}"
            )
        quantity = all_of_them[names.index(name)]
        if not quantity.least <= value <= quantity.most or (quantity.is_size and value <= 0.0):
            raise ConfigurationError(
                f"--measured {name}={value:g}: it is to be from {quantity.least:g} to {quantity.most:g} {quantity.unit}"
            )
    return tuple(_measured(q, measured[q.name]) if q.name in measured else q for q in all_of_them)


def _measured(q: Quantity, value: float) -> Quantity:
    deviation = _MEASURED if q.is_size else max(abs(value), 0.01) * _MEASURED
    return dataclasses.replace(q, known=value, deviation=deviation)


def prior(all_of_them: Sequence[Quantity]) -> tuple[Matrix, Matrix]:
    """The coordinates of what is known before, and their standard deviations."""
    return np.array([q.coordinate for q in all_of_them]), np.array([q.deviation for q in all_of_them])
