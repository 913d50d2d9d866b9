# SPDX-License-Identifier: MIT
"""A robot that is wired or mounted wrongly: what its motors are given and its sensors show, by kind of error."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from segway_ecc.hil.rig.fronts import PlantFront
from segway_ecc.node.model.model import Model
from segway_ecc.node.safety.tilt import GRAVITY

Values = dict[str, float]
_RATE: Final = tuple(f"imu.angular_velocity_{axis}" for axis in "xyz")
_FORCE: Final = tuple(f"imu.linear_acceleration_{axis}" for axis in "xyz")
_ENCODERS: Final = ("angle", "velocity")
_DEGREES: Final = 180.0 / math.pi


def _same(_values: Values) -> None:
    """Change nothing."""


@dataclass(frozen=True, slots=True)
class Miswiring:
    """One error.

    Attributes:
        name: For people, and to choose it by.
        step: The step of commissioning that is to find it.
        says: What the reason is to contain.
        motors: Changes what the motors are given, by `left` and `right`.
        sensors: Changes what the sensors show, by the output's name.
        parameters: Of the plant, other than the robot file's.
        lacks: What the devices lack: `watchdog` or `e-stop`.
    """

    name: str
    step: str
    says: str
    motors: Callable[[Values], None] = _same
    sensors: Callable[[Values], None] = _same
    parameters: Mapping[str, float] | None = None
    lacks: str = ""


def _factor(factor: float, *names: str) -> Callable[[Values], None]:
    def change(values: Values) -> None:
        for name in names:
            values[name] *= factor

    return change


def _exchange(*pairs: tuple[str, str]) -> Callable[[Values], None]:
    def change(values: Values) -> None:
        for one, other in pairs:
            values[one], values[other] = values[other], values[one]

    return change


def _turned(*axes: str) -> Callable[[Values], None]:
    """An IMU whose x, y and z lie on these axes of the robot."""

    def change(values: Values) -> None:
        for names in (_RATE, _FORCE):
            true = {name[-1]: values[name] for name in names}
            for name, axis in zip(names, axes, strict=True):
                values[name] = true[axis[1]] * (-1.0 if axis[0] == "-" else 1.0)

    return change


def _pitched(angle: float) -> Callable[[Values], None]:
    """An IMU that is mounted with its nose down by an angle, rad."""

    def change(values: Values) -> None:
        for x, _, z in (_RATE, _FORCE):
            ahead, up = values[x], values[z]
            values[x] = ahead * math.cos(angle) - up * math.sin(angle)
            values[z] = ahead * math.sin(angle) + up * math.cos(angle)

    return change


def _wheel(side: str) -> tuple[str, ...]:
    return tuple(f"{side}.{kind}" for kind in _ENCODERS)


_SWAPPED_ENCODERS: Final = tuple(zip(_wheel("left"), _wheel("right"), strict=True))
_ALL: Final = (
    Miswiring("drives swapped", "encoders", "swapped", _exchange(("left", "right")), _exchange(*_SWAPPED_ENCODERS)),
    Miswiring("encoders swapped", "encoders", "swapped", sensors=_exchange(*_SWAPPED_ENCODERS)),
    Miswiring("motors swapped", "motors", "motors are swapped", _exchange(("left", "right"))),
    Miswiring("left encoder reversed", "encoders", "left encoder is reversed", sensors=_factor(-1.0, *_wheel("left"))),
    Miswiring(
        "right encoder reversed", "encoders", "right encoder is reversed", sensors=_factor(-1.0, *_wheel("right"))
    ),
    Miswiring("left encoder frozen", "encoders", "frozen or not connected", sensors=_factor(0.0, *_wheel("left"))),
    Miswiring("right encoder frozen", "encoders", "frozen or not connected", sensors=_factor(0.0, *_wheel("right"))),
    Miswiring("left encoder counts twice", "encoders", "left encoder's scale", sensors=_factor(2.0, *_wheel("left"))),
    Miswiring("right encoder counts half", "encoders", "right encoder's scale", sensors=_factor(0.5, *_wheel("right"))),
    Miswiring("gear ratio wrong", "encoders", "gear_ratio", sensors=_factor(1.25, *_wheel("left"), *_wheel("right"))),
    Miswiring("left motor reversed", "motors", "left motor is reversed", _factor(-1.0, "left")),
    Miswiring("right motor reversed", "motors", "right motor is reversed", _factor(-1.0, "right")),
    Miswiring("left motor dead", "motors", "left motor is dead", _factor(0.0, "left")),
    Miswiring("right motor dead", "motors", "right motor is dead", _factor(0.0, "right")),
    Miswiring("left motor at half", "strength", "left motor's scale", _factor(0.5, "left")),
    Miswiring("both motors at half", "strength", "both motors' scale", _factor(0.5, "left", "right")),
    Miswiring("IMU turned -90 about x", "imu", "by -90 degrees about x", sensors=_turned("+x", "-z", "+y")),
    Miswiring("IMU turned 90 about x", "imu", "by 90 degrees about x", sensors=_turned("+x", "+z", "-y")),
    Miswiring("IMU turned 180 about x", "imu", "by 180 degrees about x", sensors=_turned("+x", "-y", "-z")),
    Miswiring("IMU turned -90 about y", "imu", "by -90 degrees about y", sensors=_turned("+z", "+y", "-x")),
    Miswiring("IMU turned 90 about y", "imu", "by 90 degrees about y", sensors=_turned("-z", "+y", "+x")),
    Miswiring("IMU turned 180 about y", "imu", "by 180 degrees about y", sensors=_turned("-x", "+y", "-z")),
    Miswiring("IMU turned -90 about z", "imu", "by -90 degrees about z", sensors=_turned("-y", "+x", "+z")),
    Miswiring("IMU turned 90 about z", "imu", "by 90 degrees about z", sensors=_turned("+y", "-x", "+z")),
    Miswiring("IMU turned 180 about z", "imu", "by 180 degrees about z", sensors=_turned("-x", "-y", "+z")),
    Miswiring("IMU axes x and y swapped", "imu", "swapped or mirrored", sensors=_turned("+y", "+x", "+z")),
    Miswiring("gyro sign reversed", "imu", "gyro's sign is reversed about x, y, z", sensors=_factor(-1.0, *_RATE)),
    Miswiring("gyro y reversed", "imu", "gyro's sign is reversed about y", sensors=_factor(-1.0, _RATE[1])),
    Miswiring("gyro in degrees", "imu", "degrees per second", sensors=_factor(_DEGREES, *_RATE)),
    Miswiring("accelerometer in g", "imu", "gives g", sensors=_factor(1.0 / GRAVITY, *_FORCE)),
    Miswiring("IMU frozen", "signals", "do not change", sensors=_factor(0.0, *_RATE, *_FORCE)),
    Miswiring("pitch zero off", "pitch zero", "zero of pitch is off", sensors=_pitched(0.1)),
    Miswiring("wheels larger", "wheel radius", "wheel radius is 0.06", parameters={"WheelRadius": 0.06}),
    Miswiring("track wider", "track", "set Track", parameters={"Track": 0.4}),
    Miswiring("no watchdog", "watchdog", "watchdog", lacks="watchdog"),
    Miswiring("e-stop without effect", "e-stop", "does not end torque", lacks="e-stop"),
)
ERRORS: Final = {error.name: error for error in _ALL}
"""The errors that a simulated robot can have, by name."""


class MiswiredPlant(PlantFront):
    """A plant whose motors and sensors are wired as an error has them."""

    def __init__(self, plant: Model, error: Miswiring) -> None:
        """Stand in front of `plant`."""
        super().__init__(plant)
        self._error = error
        self._given = [variable.name.partition(".")[0] for variable in plant.inputs]
        self._shown = [variable.name for variable in plant.outputs]

    def initialize(self, u: Sequence[float]) -> list[float]:
        """Start at time zero; see `Model.initialize`."""
        return self._sense(super().initialize(u))

    def advance(self, u: Sequence[float], steps: int) -> list[float]:
        """Push with what reaches the motors, some steps at once; return what the sensors show."""
        values = dict(zip(self._given, u, strict=True))
        self._error.motors(values)
        return self._sense(super().advance([values[name] for name in self._given], steps))

    def _sense(self, outputs: Sequence[float]) -> list[float]:
        values = dict(zip(self._shown, outputs, strict=True))
        self._error.sensors(values)
        return [values[name] for name in self._shown]
