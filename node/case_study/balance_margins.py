"""How much a balancing robot bears: the largest of each disturbance that it recovers from, found by bisection."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from node.case_study.balance import Balance, Truth
from node.config import RobotFile
from node.models.segway_parameters import PUBLISHED, SegwayParameters
from node.models.segway_phases import Phase

PUSH_S: Final = 0.1
"""How long a push lasts."""
PAYLOAD_SHARE: Final = 0.3
SLOPE_RAD: Final = math.radians(5.0)
DELAY_S: Final = 0.020
GYRO_BIAS: Final = 0.02
"""Four times the standard deviation that the plant's gyro has."""

LIES_AT: Final = PUBLISHED.stop_angle
"""Pitch at the start, rad."""

_DISTURBED_AT_S: Final = 4.0
_DURATION_S: Final = 12.0
_NUDGE_N: Final = 10.0
_DELAYED_AT_S: Final = 2.0
_STEPS: Final = 90
_STEP_S: Final = 0.02
_RECOVERED_PITCH: Final = 0.15
_RECOVERED_SPEED: Final = 0.3
_RECOVERED_RATE: Final = 0.5
"""Far more than at rest; a robot that shakes has not recovered."""
_STAYED_S: Final = 1.0

Script = dict[float, Callable[[Balance], None]]


@dataclass(frozen=True, slots=True)
class Disturbance:
    """A kind of disturbance.

    Attributes:
        name: What it is.
        unit: Of its size.
        most: The largest size tried; may be negative, which searches below zero.
        resolution: How closely the limit is found.
        required: What must be borne; None where nothing is.
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
    """What was found.

    Attributes:
        name: The disturbance.
        unit: Of the sizes.
        borne: The largest size borne with every seed.
        required: What must be borne; None where nothing is.
        is_beyond: Whether even the largest size tried was borne.
    """

    name: str
    unit: str
    borne: float
    required: float | None
    is_beyond: bool

    @property
    def is_enough(self) -> bool:
        """Whether what must be borne is."""
        return self.required is None or abs(self.borne) >= abs(self.required) - 1e-9


def disturbances(body: SegwayParameters) -> Sequence[Disturbance]:
    """All kinds, for a robot with this body."""
    payload, centre = PAYLOAD_SHARE * body.body_mass, body.body_height_of_centre
    lightest = 0.9 * body.body_mass

    def plain(_: float) -> Mapping[str, float]:
        return {}

    def carried(size: float) -> Mapping[str, float]:
        return {"Payload": size, "PayloadHeight": centre}

    return (
        Disturbance("push ahead, 0.1 s", "N", 400.0, 1.0, None, plain, _push),
        Disturbance("push back, 0.1 s", "N", -400.0, 1.0, None, plain, _push),
        Disturbance("payload at the centre, more", "kg", 3.0 * body.body_mass, 0.1, payload, carried, _nudge),
        Disturbance("payload at the centre, less", "kg", -lightest, 0.1, -payload, carried, _nudge),
        Disturbance("slope, up", "rad", 0.4, 0.005, SLOPE_RAD, plain, _slope),
        Disturbance("slope, down", "rad", -0.4, 0.005, -SLOPE_RAD, plain, _slope),
        Disturbance("delay added", "s", 0.1, 0.001, DELAY_S, plain, _delay),
        Disturbance("gyro bias, sudden", "rad/s", 0.5, 0.005, GYRO_BIAS, plain, _bias("GyroY")),
        Disturbance("accelerometer bias, sudden", "m/s2", 5.0, 0.05, None, plain, _bias("AccelerationX")),
    )


def find_limit(file: RobotFile, kind: Disturbance, seeds: Sequence[int]) -> Limit:
    """The largest size borne with every seed; it is taken that less than what is borne is borne too."""

    def is_borne(size: float) -> bool:
        return all(recovers(file, kind, size, seed) for seed in seeds)

    if is_borne(kind.most):
        return Limit(kind.name, kind.unit, kind.most, kind.required, is_beyond=True)
    borne, too_much = 0.0, kind.most
    while abs(too_much - borne) > kind.resolution:
        middle = 0.5 * (borne + too_much)
        if is_borne(middle):
            borne = middle
        else:
            too_much = middle
    return Limit(kind.name, kind.unit, borne, kind.required, is_beyond=False)


def recovers(file: RobotFile, kind: Disturbance, size: float, seed: int) -> bool:
    """Whether the robot stands up, is disturbed, and balances at the end, still and without having given up."""
    balance = Balance(file, pitch=LIES_AT, seed=seed, plant=kind.plant(size))
    truth = balance.run(_DURATION_S, kind.script(size), until_given_up=True)
    last = [at for at in truth if at.time > _DURATION_S - _STAYED_S]
    return (
        Phase.GIVEN_UP not in balance.phases
        and balance.phases[-1] == Phase.BALANCING
        and all(_is_calm(at) for at in last)
    )


def _is_calm(at: Truth) -> bool:
    return (
        abs(at.pitch) < _RECOVERED_PITCH
        and abs(at.pitch_rate) < _RECOVERED_RATE
        and abs(at.linear_velocity) < _RECOVERED_SPEED
    )


def _push(force: float) -> Script:
    return {
        _DISTURBED_AT_S: lambda balance: balance.plant.write("PushForce", force),
        _DISTURBED_AT_S + PUSH_S: lambda balance: balance.plant.write("PushForce", 0.0),
    }


def _nudge(_size: float = 0.0) -> Script:
    return _push(_NUDGE_N)


def _slope(slope: float) -> Script:
    """The ground tilts over two seconds under the robot, as where it rolls onto a ramp."""

    def tilt(share: float) -> Callable[[Balance], None]:
        return lambda balance: balance.plant.write("Slope", slope * share)

    return {_DISTURBED_AT_S + i * _STEP_S: tilt((i + 1) / _STEPS) for i in range(_STEPS)}


def _delay(delay: float) -> Script:
    """Frames come later and later, so that no gap between them looks like a lost bus; then a nudge."""

    def late(share: float) -> Callable[[Balance], None]:
        def set_delay(balance: Balance) -> None:
            balance.link.delay_ns = round(delay * share * 1e9)

        return set_delay

    growing = {_DELAYED_AT_S + i * _STEP_S: late((i + 1) / _STEPS) for i in range(_STEPS)}
    return {**growing, **_nudge()}


def _bias(name: str) -> Callable[[float], Script]:
    def script(size: float) -> Script:
        def off(balance: Balance) -> None:
            balance.model.biases[name] = size

        return {_DISTURBED_AT_S: off}

    return script
