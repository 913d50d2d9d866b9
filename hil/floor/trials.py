# SPDX-License-Identifier: MIT
"""What a robot is tried with on a floor: trials as data, and which packaged robots do not withstand them.

Each robot stands up from a bumper at 0 s and stands by `UP_S`, when it is pushed or begins to drive. The floor has a
friction of 0.8 where a trial gives no other.
"""

import math
from collections.abc import Iterator, Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Final, NamedTuple

from segway_ecc.hil.floor.contact import tyres
from segway_ecc.node.models.segway_parameters import SegwayParameters, model_name

UP_S: Final = 3.5
"""When it stands, and trials begin, s."""
_WAY_M: Final = 1.8
"""How far it drives over an obstacle that is 0.3 m ahead."""
_SETTLES_S: Final = 1.0
"""How long a trial on obstacles goes on: a robot that fell counts as fallen half a second later."""
_AXES: Final = ("roll", "pitch", "yaw")
_NOTHING: Final[Mapping[str, float]] = MappingProxyType({})


class TrialKind(StrEnum):
    """What is tried."""

    FLOOR = "floor"
    SLOPE = "slope"
    PARAMETER = "parameter error"
    IMPERFECTION = "imperfection"
    PUSH = "push"
    OBSTACLE = "obstacle"


class FloorTrial(NamedTuple):
    """One trial.

    Attributes:
        name: Of its own.
        pitch: How it lies at first, rad.
        plant: Parameters and states of the plant that are other than the robot's own.
        push: Force ahead at the centre of mass, N.
        push_s: How long, s.
        speed: Set-point after it stands, m/s.
        duration_s: Of it all.
    """

    name: str
    kind: TrialKind
    pitch: float
    plant: Mapping[str, float] = _NOTHING
    push: float = 0.0
    push_s: float = 0.0
    speed: float = 0.0
    duration_s: float = 8.0


_BOTH: Final = frozenset({"segway", "segway-odrive"})
_ODRIVE: Final = frozenset({"segway-odrive"})
FALLS: Final[Mapping[str, frozenset[str]]] = MappingProxyType(
    {
        "friction 0.5, front bumper": _ODRIVE,
        "friction 0.5, rear bumper": _BOTH,
        "WheelRadius times 0.7": _BOTH,
        "board of 1 cm, both wheels, 0.2 m/s": _ODRIVE,
        "board of 1 cm, both wheels, 0.4 m/s": _ODRIVE,
        "board of 1 cm, both wheels, 0.6 m/s": _BOTH,
        "board of 1 cm, left wheel, 0.2 m/s": _BOTH,
    }
)
"""Of the trials that the documentation lists: which packaged robots do not withstand it, with seed 1."""


def listed_trials(p: SegwayParameters) -> tuple[FloorTrial, ...]:
    """Those that the documentation lists, for a robot with these parameters."""
    return (
        *_on_frictions(p, 0.5, 0.6, 0.8, 1.2),
        *_on_slopes(p, -5.0, 5.0),
        *_unlike(p, "body_mass", "body_height_of_centre", "wheel_radius"),
        *_imperfect(p, {"sensor errors times 3": {"SensorErrors": 3.0}}),
        *_imperfect(p, {"cogging 0.02 N m": {"Cogging": 0.02}}),
        *_imperfect(p, {"backlash 0.5 degrees": {"Backlash": math.radians(0.5)}}),
        *_pushed(p, 0.6, (50.0, 0.1), (10.0, 1.0)),
        *_pushed(p, 0.8, (10.0, 1.0)),
        *_driving(p),
    )


def all_trials(p: SegwayParameters) -> tuple[FloorTrial, ...]:
    """Those, and more of each kind."""
    board = {"KerbAt": 0.3, "KerbLength": 0.2}
    return (
        *listed_trials(p),
        *_on_frictions(p, 0.55, 0.7, 1.0),
        FloorTrial("friction 0.6 left, 0.9 right", TrialKind.FLOOR, p.stop_angle, _unlike_tyres(0.6, 0.9)),
        *_on_slopes(p, -3.0, 3.0),
        *_unlike(p, "motor_constant", "wheel_inertia", "imu_height"),
        *_unlike_inertias(p),
        *_imperfect(p, {"cable drag 2 N": {"CableDrag": 2.0}, "IMU vibration 2 m/s2": {"ImuVibration": 2.0}}),
        *_imperfect(p, {"errors times 3, cogging, backlash": _all_errors()}),
        *_pushed(p, 0.8, (50.0, 0.1)),
        *_pushed(p, 0.5, (30.0, 0.1)),
        *_over(p, "kerb of 1 cm, both wheels", (0.2, 0.4, 0.6), KerbAt=0.3, KerbHeight=0.01),
        *_over(p, "kerb of 1 cm, left wheel", (0.4,), KerbAt=0.3, KerbHeight=0.01, KerbSide=1.0),
        *_over(p, "board of 3 mm, both wheels", (0.4,), KerbHeight=0.003, **board),
        *_over(p, "board of 2 cm, both wheels", (0.2, 0.4, 0.6), KerbHeight=0.02, **board),
        *_over(p, "gravel of 1 cm", (0.2, 0.4), GravelAt=0.3, GravelLength=0.5, GravelHeight=0.01),
        *_over(p, "drop of 2 cm", (0.2, 0.4), KerbAt=0.3, KerbHeight=-0.02),
        *_over(p, "ramp up 5 degrees", (0.4,), RampAt=0.3, RampLength=1.0, RampAngle=math.radians(5.0)),
        *_over(p, "ramp down 5 degrees", (0.4,), RampAt=0.3, RampLength=1.0, RampAngle=math.radians(-5.0)),
    )


def _bumpers(p: SegwayParameters) -> tuple[tuple[str, float], ...]:
    return ("front", p.stop_angle), ("rear", -p.stop_angle)


def _on_frictions(p: SegwayParameters, *frictions: float) -> Iterator[FloorTrial]:
    for side, pitch in _bumpers(p):
        for friction in frictions:
            yield FloorTrial(f"friction {friction}, {side} bumper", TrialKind.FLOOR, pitch, tyres(friction))


def _unlike_tyres(left: float, right: float) -> Mapping[str, float]:
    return {"LeftFriction": left, "RightFriction": right}


def _on_slopes(p: SegwayParameters, *slopes_deg: float) -> Iterator[FloorTrial]:
    for side, pitch in _bumpers(p):
        for degrees in slopes_deg:
            slope = math.radians(degrees)  # the stop is against the ground's normal, which leans back where it rises
            name = f"slope {degrees:g} degrees, {side} bumper"
            yield FloorTrial(name, TrialKind.SLOPE, pitch - slope, {"Slope": slope})


def _unlike(p: SegwayParameters, *fields: str) -> Iterator[FloorTrial]:
    for field in fields:
        name = model_name(field)
        for factor in (0.7, 1.3):
            plant = {name: factor * getattr(p, field)}
            yield FloorTrial(f"{name} times {factor}", TrialKind.PARAMETER, p.stop_angle, plant)


def _unlike_inertias(p: SegwayParameters) -> Iterator[FloorTrial]:
    """All three of the body together: one alone would be that of no rigid body."""
    for factor in (0.7, 1.3):
        plant = {model_name(f"body_{axis}_inertia"): factor * getattr(p, f"body_{axis}_inertia") for axis in _AXES}
        yield FloorTrial(f"body's inertias times {factor}", TrialKind.PARAMETER, p.stop_angle, plant)


def _imperfect(p: SegwayParameters, plants: Mapping[str, Mapping[str, float]]) -> Iterator[FloorTrial]:
    for name, plant in plants.items():
        yield FloorTrial(name, TrialKind.IMPERFECTION, p.stop_angle, plant)


def _all_errors() -> Mapping[str, float]:
    return {"SensorErrors": 3.0, "Cogging": 0.02, "Backlash": math.radians(0.5)}


def _pushed(p: SegwayParameters, friction: float, *pushes: tuple[float, float]) -> Iterator[FloorTrial]:
    for side, sign in (("ahead", 1.0), ("back", -1.0)):
        for force, seconds in pushes:
            name = f"{force:g} N {side} for {seconds:g} s, friction {friction}"
            yield FloorTrial(name, TrialKind.PUSH, p.stop_angle, tyres(friction), sign * force, seconds)


def _driving(p: SegwayParameters) -> Iterator[FloorTrial]:
    board = {"KerbAt": 0.3, "KerbHeight": 0.01, "KerbLength": 0.2}
    yield from _over(p, "board of 1 cm, both wheels", (0.2, 0.4, 0.6), **board)
    yield from _over(p, "board of 1 cm, left wheel", (0.2, 0.4, 0.6), **board, KerbSide=1.0)
    yield from _over(p, "ice of 0.2", (0.2, 0.6), IceAt=0.2, IceLength=0.5, IceFriction=0.2)


def _over(p: SegwayParameters, name: str, speeds: tuple[float, ...], **ground: float) -> Iterator[FloorTrial]:
    """It gets up from its rear bumper, backwards, and drives ahead over what lies there."""
    for speed in speeds:
        duration_s = UP_S + _WAY_M / speed + _SETTLES_S
        yield FloorTrial(
            f"{name}, {speed} m/s", TrialKind.OBSTACLE, -p.stop_angle, ground, speed=speed, duration_s=duration_s
        )
