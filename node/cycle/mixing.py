# SPDX-License-Identifier: MIT
"""What stands between a port and the robot's signals: gain, offset, and the standard mixings.

The mixing of a differential drive is the kinematics of wheels that roll, and its dual for what drives them: with radius
r, track b and the mean speeds w of the wheels of either side,

    v = r (w_right + w_left) / 2        omega = r (w_right - w_left) / b

and, so that the wheels give the power of force and moment, F v + M omega, with n wheels on either side,

    torque_left = r (F / 2 - M / b) / n        torque_right = r (F / 2 + M / b) / n

(any text on mobile robots; Siegwart, Nourbakhsh, Scaramuzza, "Introduction to Autonomous Mobile Robots", 2nd ed., 3.2).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Final, NamedTuple

import msgspec

from segway_ecc.firmware_io.settings import AxisName
from segway_ecc.firmware_io.value import Positive, Section
from segway_ecc.node.errors import ConfigurationError

GEOMETRY: Final = "geometry."
"""Begins the name of a length: a parameter that is wired to `geometry.track` has that."""
Side = Annotated[tuple[AxisName, ...], msgspec.Meta(min_length=1, max_length=8)]


class WiredSignal(Section, frozen=True, kw_only=True):
    """A signal that a port is joined to by more than its name.

    Where a value goes it arrives multiplied by the gain, with the offset added: at the port of a model that takes it,
    at the signal where a model gives it.

    Attributes:
        signal: Its name.
        gain: Not zero; in the unit of what takes the value by the unit of what gives it.
        offset: In the unit of what takes the value.
    """

    signal: str
    gain: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no number, and a gain of zero; ValueError."""
        if not (math.isfinite(self.gain) and math.isfinite(self.offset)) or self.gain == 0.0:
            raise ValueError(f"gain {self.gain:g} and offset {self.offset:g}: both must be finite, and gain not zero")

    @property
    def is_plain(self) -> bool:
        """Whether the value passes as it is, so that nothing is to be computed."""
        return self.gain == 1.0 and self.offset == 0.0


def wired_signal(entry: str | WiredSignal) -> WiredSignal:
    """An entry of a wiring, which is the name of a signal where there is no more to it."""
    return WiredSignal(signal=entry) if isinstance(entry, str) else entry


class GeometrySection(Section, frozen=True, kw_only=True):
    """The lengths of a robot, which its checks, its mixing and its model share.

    Attributes:
        wheel_radius: m.
        track: Between the wheels' points of contact, m; of wheels that are dragged around a curve, as they act.
        imu_height: Of the IMU above the axle, m.
    """

    wheel_radius: Positive | None = None
    track: Positive | None = None
    imu_height: Annotated[float, msgspec.Meta(ge=-3.0, le=3.0)] | None = None


class DifferentialMixing(Section, frozen=True, kw_only=True, tag="differential"):
    """Wheels on either side turn the robot by their difference: the axes on the left, and those on the right."""

    left: Side = ("left",)
    right: Side = ("right",)


class Mixed(NamedTuple):
    """A value made of several signals, or spread over them: its unit, and the factor of each signal."""

    unit: str
    factors: Mapping[str, float]


class Share(NamedTuple):
    """What a port gives to a signal: its value times the factor, and an offset."""

    port: str
    factor: float
    offset: float

    @property
    def is_plain(self) -> bool:
        """Whether the value passes as it is."""
        return self.factor == 1.0 and self.offset == 0.0


@dataclass(frozen=True, slots=True)
class Mixer:
    """What a mixing adds to the signals that ports can be wired to, by name.

    Attributes:
        takes: What a port may take, as a sum of signals.
        gives: What a port may give, with the share that each signal has of it.
        wheels: The axes of the left and the right wheel of each pair; of sides with unequal many, as far as there are.
    """

    takes: Mapping[str, Mixed]
    gives: Mapping[str, Mixed]
    wheels: Sequence[tuple[str, str]]


class _Wheels:
    """The wheels of a differential drive: their names, and the factors between them and the robot."""

    def __init__(self, mixing: DifferentialMixing, radius: float, track: float) -> None:
        left, right = mixing.left, mixing.right
        turn = 0.5 * track / radius
        self.mean = {axis: 0.5 * radius / len(side) for side in (left, right) for axis in side}
        """From the wheels' motion to the robot's ahead; from its force to their torques."""
        sides = ((left, -1.0), (right, 1.0))
        self.difference = {axis: sign * radius / (track * len(side)) for side, sign in sides for axis in side}
        """From the wheels' motion to the robot's turning; from its moment to their torques."""
        self.ahead = dict.fromkeys((*left, *right), 1.0 / radius)
        """From the robot's motion ahead to the wheels'; from their torques to its force."""
        self.turning = {axis: sign * turn for side, sign in sides for axis in side}
        """From the robot's turning to the wheels'; from their torques to its moment."""


def _of(factors: Mapping[str, float], value: str) -> dict[str, float]:
    return {f"{axis}.{value}": factor for axis, factor in factors.items()}


def _lengths(name: str, geometry: GeometrySection) -> tuple[float, float]:
    if geometry.wheel_radius is None or geometry.track is None:
        raise ConfigurationError(f"mixing.{name} needs geometry.wheel_radius and geometry.track")
    return geometry.wheel_radius, geometry.track


def controller_mixers(mixings: Mapping[str, DifferentialMixing], geometry: GeometrySection) -> list[Mixer]:
    """What a controller can be wired to: how the robot moves by its wheels, and what is to move it.

    Raises:
        ConfigurationError: The geometry lacks a length.
    """
    return [_for_controller(name, mixing, *_lengths(name, geometry)) for name, mixing in mixings.items()]


def plant_mixers(mixings: Mapping[str, DifferentialMixing], geometry: GeometrySection) -> list[Mixer]:
    """What a plant can be wired to: what its wheels' drives give it, and how it moves.

    Raises:
        ConfigurationError: The geometry lacks a length.
    """
    return [_for_plant(name, mixing, *_lengths(name, geometry)) for name, mixing in mixings.items()]


def _for_controller(name: str, mixing: DifferentialMixing, radius: float, track: float) -> Mixer:
    wheels, steer = _Wheels(mixing, radius, track), 0.5 * track / radius
    linear, angular = "setpoint.linear_velocity", "setpoint.angular_velocity"
    sides = {"left": mixing.left, "right": mixing.right}
    return Mixer(
        takes={
            f"{name}.linear_velocity": Mixed("m/s", _of(wheels.mean, "velocity")),
            f"{name}.angular_velocity": Mixed("rad/s", _of(wheels.difference, "velocity")),
            f"{name}.distance": Mixed("m", _of(wheels.mean, "angle")),
            f"{name}.rotation": Mixed("rad", _of(wheels.difference, "angle")),
            f"{name}.left_setpoint": Mixed("rad/s", {linear: 1.0 / radius, angular: -steer}),
            f"{name}.right_setpoint": Mixed("rad/s", {linear: 1.0 / radius, angular: steer}),
        },
        gives={
            f"{name}.force": Mixed("N", _of(wheels.mean, "torque")),
            f"{name}.moment": Mixed("N m", _of(wheels.difference, "torque")),
            **{f"{name}.{side}_torque": Mixed("N m", _of(_each(axes), "torque")) for side, axes in sides.items()},
            **{f"{name}.{side}_voltage": Mixed("V", _of(_each(axes), "voltage")) for side, axes in sides.items()},
        },
        wheels=_pairs(mixing),
    )


def _for_plant(name: str, mixing: DifferentialMixing, radius: float, track: float) -> Mixer:
    wheels = _Wheels(mixing, radius, track)
    return Mixer(
        takes={
            f"{name}.force": Mixed("N", _of(wheels.ahead, "torque")),
            f"{name}.moment": Mixed("N m", _of(wheels.turning, "torque")),
        },
        gives={
            f"{name}.linear_velocity": Mixed("m/s", _of(wheels.ahead, "velocity")),
            f"{name}.angular_velocity": Mixed("rad/s", _of(wheels.turning, "velocity")),
            f"{name}.distance": Mixed("m", _of(wheels.ahead, "angle")),
            f"{name}.rotation": Mixed("rad", _of(wheels.turning, "angle")),
        },
        wheels=_pairs(mixing),
    )


def _pairs(mixing: DifferentialMixing) -> list[tuple[str, str]]:
    return list(zip(mixing.left, mixing.right, strict=False))


def _each(axes: Sequence[str]) -> dict[str, float]:
    return dict.fromkeys(axes, 1.0)


def taken(mixers: Sequence[Mixer]) -> dict[str, Mixed]:
    """Everything that a port may take of several mixings."""
    return {signal: mixed for mixer in mixers for signal, mixed in mixer.takes.items()}


def given(mixers: Sequence[Mixer]) -> dict[str, Mixed]:
    """Everything that a port may give of several mixings."""
    return {signal: mixed for mixer in mixers for signal, mixed in mixer.gives.items()}


def spread(wired: Mapping[str, WiredSignal], mixers: Sequence[Mixer], where: str = "wiring") -> dict[str, list[Share]]:
    """For each signal that ports give, the shares that they have in it; errors call the place `where`.

    Raises:
        ConfigurationError: Two ports give the same, or one gives a signal that another has a share in.
    """
    mixes, found = given(mixers), dict[str, list[Share]]()
    giver_of: dict[str, str] = {}
    for port, entry in wired.items():
        mixed = mixes.get(entry.signal)
        other = giver_of.setdefault(entry.signal, port)
        if other != port:
            raise _twice(where, other, port, entry.signal)
        for signal, factor in (mixed.factors if mixed else {entry.signal: 1.0}).items():
            shares = found.setdefault(signal, [])
            if shares and (mixed is None or signal in giver_of):
                raise _twice(where, shares[0].port, port, signal)
            shares.append(Share(port, entry.gain * factor, entry.offset * factor))
    return found


def _twice(where: str, first: str, second: str, signal: str) -> ConfigurationError:
    return ConfigurationError(f"{where}: '{first}' and '{second}' both drive '{signal}'; keep one")
