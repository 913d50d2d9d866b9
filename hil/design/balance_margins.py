# SPDX-License-Identifier: MIT
"""The disturbance limits of a balancing robot: the largest of each from which it recovers, found by bisection."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from segway_ecc.hil.design.balance import Balance
from segway_ecc.node.config import RobotFile
from segway_ecc.node.models.segway_law import Phase
from segway_ecc.node.models.segway_parameters import PUBLISHED, SegwayParameters
from segway_ecc.node.safety.posture import Posture

PUSH_S: Final = 0.1
"""How long a shove lasts."""
LONG_PUSH_S: Final = 1.0
"""How long a push lasts by which balancers of Upkie, the published robot, are compared: its largest sagittal force."""
LONG_PUSH_N: Final = 10.0
"""What a published test of an Upkie pushes its torso with for a second (rgambard/Upkie-Robotics-RL, test.py)."""
PAYLOAD_SHARE: Final = 0.3
SLOPE_RAD: Final = math.radians(5.0)
DELAY_S: Final = 0.020
GYRO_BIAS: Final = 0.02
"""Four times the standard deviation that the plant's gyro has."""
TRACKING_ERROR: Final = 0.05
TRACKED_WITHIN: Final = 0.1
"""Of a step by 1 m/s or 1 rad/s."""
LIES_AT: Final = PUBLISHED.stop_angle
"""Pitch at the start, rad."""
_DISTURBED_AT_S: Final = 4.0
_DURATION_S: Final = 12.0
_NUDGE_N: Final = 10.0
_DELAYED_AT_S: Final = 2.0
_STEPS: Final = 90
_STEP_S: Final = 0.02
_STEPPED_AT_S: Final = 3.0
_TRACKED_S: Final = 12.0
_STEADY_S: Final = 3.0
_RECOVERED_PITCH: Final = 0.15
_RECOVERED_SPEED: Final = 0.3
_RECOVERED_RATE: Final = 0.5
"""Far more than at rest; a robot that shakes has not recovered."""
_STAYED_S: Final = 1.0

Script = dict[float, Callable[[Balance], None]]


class DisturbanceKind(NamedTuple):
    """A kind of disturbance.

    Attributes:
        unit: Of its size.
        most: The largest size tried; may be negative, which searches below zero.
        resolution: How closely the limit is found.
        required: What it must tolerate; None where nothing is required.
        plant: Parameters and states of the plant for a size.
        script: What happens for a size.
    """

    name: str
    unit: str
    most: float
    resolution: float
    required: float | None
    plant: Callable[[float], Mapping[str, float]]
    script: Callable[[float], Script]


@dataclass(frozen=True, slots=True)
class Limit:
    """What was found of a `DisturbanceKind`: the largest size tolerated with every seed, and if all tried were."""

    name: str
    unit: str
    tolerated: float
    required: float | None
    is_beyond: bool

    @property
    def is_enough(self) -> bool:
        """Whether what is required is tolerated."""
        return self.required is None or abs(self.tolerated) >= abs(self.required) - 1e-9


def disturbances(body: SegwayParameters) -> Sequence[DisturbanceKind]:
    """All kinds, for a robot with this body."""
    payload, centre = PAYLOAD_SHARE * body.body_mass, body.body_height_of_centre

    def plain(_: float) -> Mapping[str, float]:
        return {}

    def carried(size: float) -> Mapping[str, float]:
        return {"Payload": size, "PayloadHeight": centre}

    def long_push(force: float) -> Script:
        return _push(force, LONG_PUSH_S)

    def nudge(_: float) -> Script:
        return _push(_NUDGE_N)

    return (
        DisturbanceKind("push ahead, 0.1 s", "N", 400.0, 1.0, None, plain, _push),
        DisturbanceKind("push back, 0.1 s", "N", -400.0, 1.0, None, plain, _push),
        DisturbanceKind("push ahead, 1 s", "N", 100.0, 0.25, LONG_PUSH_N, plain, long_push),
        DisturbanceKind("push back, 1 s", "N", -100.0, 0.25, -LONG_PUSH_N, plain, long_push),
        DisturbanceKind("payload at the centre, more", "kg", 3.0 * body.body_mass, 0.1, payload, carried, nudge),
        DisturbanceKind("payload at the centre, less", "kg", -0.9 * body.body_mass, 0.1, -payload, carried, nudge),
        DisturbanceKind("slope, up", "rad", 0.4, 0.005, SLOPE_RAD, plain, _slope),
        DisturbanceKind("slope, down", "rad", -0.4, 0.005, -SLOPE_RAD, plain, _slope),
        DisturbanceKind("delay added", "s", 0.1, 0.001, DELAY_S, plain, _delay),
        DisturbanceKind("gyro bias, sudden", "rad/s", 0.5, 0.005, GYRO_BIAS, plain, _bias("GyroY")),
        DisturbanceKind("accelerometer bias, sudden", "m/s2", 5.0, 0.05, None, plain, _bias("AccelerationX")),
    )


def find_limit(file: RobotFile, kind: DisturbanceKind, seeds: Sequence[int]) -> Limit:
    """The largest size tolerated with every seed; less than what is tolerated is taken to be tolerated too."""

    def is_tolerated(size: float) -> bool:
        return all(recovers(file, kind, size, seed) for seed in seeds)

    is_beyond = is_tolerated(kind.most)
    tolerated, too_much = kind.most if is_beyond else 0.0, kind.most
    while abs(too_much - tolerated) > kind.resolution:
        middle = 0.5 * (tolerated + too_much)
        if is_tolerated(middle):
            tolerated = middle
        else:
            too_much = middle
    return Limit(kind.name, kind.unit, tolerated, kind.required, is_beyond)


def recovers(  # noqa: PLR0913 - the robot, what disturbs it, and how it begins
    file: RobotFile,
    kind: DisturbanceKind,
    size: float,
    seed: int,
    *,
    lies_at: float = LIES_AT,
    duration_s: float = _DURATION_S,
) -> bool:
    """Whether the robot stands up, is disturbed, and balances at the end, still and without having given up."""
    balance = Balance(file, pitch=lies_at, seed=seed, plant=kind.plant(size))
    truth = balance.run(duration_s, kind.script(size), until_fallen=True)
    last = [at for at in truth if at.time > duration_s - _STAYED_S]
    return (
        Phase.GIVEN_UP not in balance.phases
        and balance.phases[-1] == Phase.BALANCING
        and balance.postures[-1] in {Posture.BALANCING, None}
        and max(abs(at.pitch) for at in last) < _RECOVERED_PITCH
        and max(abs(at.pitch_rate) for at in last) < _RECOVERED_RATE
        and max(abs(at.linear_velocity) for at in last) < _RECOVERED_SPEED
    )


class Step(NamedTuple):
    """A set-point, m/s and rad/s, that steps from rest to 1, and the field of the truth that follows it."""

    name: str
    unit: str
    setpoint: tuple[float, float]
    field: str


STEPS: Final = (
    Step("tracks 1 m/s", "m/s", (1.0, 0.0), "linear_velocity"),
    Step("tracks 1 rad/s", "rad/s", (0.0, 1.0), "angular_velocity"),
    Step("tracks 1 m/s, turning at 1 rad/s", "m/s", (1.0, 1.0), "linear_velocity"),
)


@dataclass(frozen=True, slots=True)
class Tracking:
    """How a step was followed, by the plant's truth; of some seeds the worst.

    Attributes:
        steady_error: Of the mean over the last three seconds.
        largest_error: In these three seconds.
        settled_s: After the step, from when on it stays within a tenth of it, s; infinite where it does not.
        required: Largest steady error.
    """

    name: str
    unit: str
    steady_error: float
    largest_error: float
    settled_s: float
    required: float

    @property
    def is_enough(self) -> bool:
        """Whether it settles, and where it should."""
        return self.steady_error <= self.required and math.isfinite(self.settled_s)


def track(file: RobotFile, step: Step, seeds: Sequence[int]) -> Tracking:
    """Let it follow a step from rest, with each seed."""
    script: Script = {_STEPPED_AT_S: lambda run: run.drive(*step.setpoint)}
    runs = []
    for seed in seeds:
        truth = Balance(file, pitch=LIES_AT, seed=seed).run(_TRACKED_S, script, until_fallen=True)
        runs.append(tracked([(at.time - _STEPPED_AT_S, getattr(at, step.field) - 1.0) for at in truth]))
    steady, largest, settled_s = (max(values) for values in zip(*runs, strict=True))
    return Tracking(step.name, step.unit, steady, largest, settled_s, TRACKING_ERROR)


def tracked(errors: Sequence[tuple[float, float]]) -> tuple[float, float, float]:
    """Steady error, largest error at the end, and when it settled, from errors at times, s, since a step by 1."""
    end_s = errors[-1][0]
    if end_s < _TRACKED_S - _STEPPED_AT_S - _STEADY_S:
        return math.inf, math.inf, math.inf  # it gave up
    last = [error for time, error in errors if time > end_s - _STEADY_S]
    off = [time for time, error in errors if abs(error) > TRACKED_WITHIN]
    settled_s = max(off, default=0.0)
    is_settled = settled_s < end_s - _STEADY_S
    return abs(sum(last) / len(last)), max(map(abs, last)), settled_s if is_settled else math.inf


def _push(force: float, duration: float = PUSH_S) -> Script:
    return {
        _DISTURBED_AT_S: lambda balance: balance.plant.write("PushForce", force),
        _DISTURBED_AT_S + duration: lambda balance: balance.plant.write("PushForce", 0.0),
    }


def _slope(slope: float) -> Script:
    """The ground tilts over two seconds under the robot, as where it rolls onto a ramp."""

    def tilt(share: float) -> Callable[[Balance], None]:
        return lambda balance: balance.plant.write("Slope", slope * share)

    return {_DISTURBED_AT_S + i * _STEP_S: tilt((i + 1) / _STEPS) for i in range(_STEPS)}


def _delay(delay: float) -> Script:
    """Frames come later and later, so that no gap between them looks like a lost bus; then a nudge."""

    def late(share: float) -> Callable[[Balance], None]:
        return lambda balance: setattr(balance.link, "delay_ns", round(delay * share * 1e9))

    growing = {_DELAYED_AT_S + i * _STEP_S: late((i + 1) / _STEPS) for i in range(_STEPS)}
    return {**growing, **_push(_NUDGE_N)}


def _bias(name: str) -> Callable[[float], Script]:
    return lambda size: {_DISTURBED_AT_S: lambda balance: balance.model.biases.update({name: size})}
