# SPDX-License-Identifier: MIT
"""A normal driving programme, made from a seed: cruising, turning, creeping, reversing, stopping; steps and ramps."""

import random
from collections.abc import Iterator
from typing import Final, NamedTuple

from segway_ecc.node.cycle.setpoints import REST, Setpoint

FIRST_S: Final = 4.0
"""At rest at first, s: the robot stands up."""
MOST_AHEAD: Final = 1.0
MOST_BACK: Final = 0.5
"""m/s: what the robot is to track ahead, and half of it backwards, where nobody looks."""
MOST_TURNING: Final = 1.0
"""rad/s, while it moves or where it stands."""

_LASTS_S: Final = (2.0, 12.0)
_RAMP_S: Final = (0.5, 3.0)
_CREEP: Final = 0.1
_KINDS: Final = ("cruise", "turn", "curve", "creep", "reverse", "stop")
_WEIGHTS: Final = (3, 2, 3, 1, 2, 3)


class Leg(NamedTuple):
    """A part of the programme.

    The target is what is asked for at its end; the ramp, s, is how long the set-point takes to get there, 0 for a step;
    it lasts, s, with the ramp included.
    """

    target: Setpoint
    ramp_s: float
    lasts_s: float


def programme(seed: int) -> Iterator[Leg]:
    """Pieces without end; the same seed gives the same ones."""
    chance = random.Random(seed)  # noqa: S311 - chance that can be repeated is what is wanted
    yield Leg(REST, 0.0, FIRST_S)
    while True:
        target = _target(chance.choices(_KINDS, _WEIGHTS)[0], chance)
        ramp_s = chance.choice((0.0, chance.uniform(*_RAMP_S)))
        yield Leg(target, ramp_s, ramp_s + chance.uniform(*_LASTS_S))


class Driver:
    """Gives the set-point of a programme at times that go on; `pieces` is how many pieces were begun."""

    def __init__(self, seed: int) -> None:
        """Drive the programme of a seed."""
        self.pieces = 0
        self._programme = programme(seed)
        self._piece = Leg(REST, 0.0, 0.0)
        self._from = REST
        self._begun_s = 0.0

    def setpoint(self, time_s: float) -> Setpoint:
        """What is asked for at a time, s since the start, no less than at the last call."""
        while time_s >= self._begun_s + self._piece.lasts_s:
            self._begun_s += self._piece.lasts_s
            self._from = self._piece.target
            self._piece = next(self._programme)
            self.pieces += 1
        since_s, ramp_s, target = time_s - self._begun_s, self._piece.ramp_s, self._piece.target
        if since_s >= ramp_s:
            return target
        share = since_s / ramp_s
        return Setpoint(*(a + share * (b - a) for a, b in zip(self._from, target, strict=True)))


def _target(kind: str, chance: random.Random) -> Setpoint:
    turning = chance.uniform(-MOST_TURNING, MOST_TURNING)
    match kind:
        case "cruise":
            return Setpoint(chance.uniform(0.3, MOST_AHEAD), 0.0)
        case "turn":
            return Setpoint(0.0, turning)
        case "curve":
            return Setpoint(chance.uniform(0.2, MOST_AHEAD), turning)
        case "creep":
            return Setpoint(chance.uniform(-_CREEP, _CREEP), chance.uniform(-_CREEP, _CREEP))
        case "reverse":
            return Setpoint(-chance.uniform(0.1, MOST_BACK), 0.5 * turning)
    return REST
