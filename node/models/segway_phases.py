"""What a segway is doing: resting on a stop, standing up, balancing, sitting down, or resting because it gave up."""

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from node.models.segway_estimate import Estimate

_UP_PITCH: Final = 0.1
_UP_RATE: Final = 0.5
_UP_TIME_S: Final = 0.1
_STILL_SPEED: Final = 0.05
_STILL_RATE: Final = 0.1
_STILL_TIME_S: Final = 0.2
_AT_STOP: Final = 0.75
"""Part of the stop's pitch from which on the body counts as down; less than one, since a slope may be under it."""
_BRAKE_GAIN: Final = 2.0
"""Sum of torques per forward speed once it is down, N s."""
_RATE_FACTOR: Final = 0.7
"""How hard the pitch rate is held while it sits down, against balancing: alone, without the pitch, it needs less."""
_LANDED_RATE: Final = 0.3
"""Pitch rate below which a body that is down lies on its stop, rad/s; above, braking would throw it there."""
_RUNAWAY_TIME_S: Final = 0.05


class Phase(enum.IntEnum):
    """What the robot is doing."""

    RESTING = 0
    """Down, the motors give nothing; stands up when told to."""
    STANDING_UP = 1
    """On its way from the stop to balance."""
    BALANCING = 2
    """Up, and following set-points."""
    SITTING_DOWN = 3
    """Leaning down onto the stop ahead, then braking."""
    GIVEN_UP = 4
    """Down, the motors give nothing; it fell or did not get up, and waits to be told to sit before it tries again."""


_PHASES: Final = tuple(Phase)
"""By number, which takes a quarter of the time of `Phase(number)`."""


class Progress(NamedTuple):
    """A phase, and how far it has come.

    Attributes:
        phase: A `Phase`, as a number.
        elapsed: How long it has lasted, s.
        lasting: How long the robot has been where the phase leads, or ends, s.
        wrong: How long the wheels have been too fast, s.
    """

    phase: float = Phase.RESTING
    elapsed: float = 0.0
    lasting: float = 0.0
    wrong: float = 0.0

    @property
    def doing(self) -> Phase:
        """The phase."""
        return _PHASES[int(self.phase)]

    @property
    def is_resting(self) -> bool:
        """Whether the motors give nothing."""
        return self.doing in (Phase.RESTING, Phase.GIVEN_UP)


@dataclass(frozen=True, slots=True)
class PhaseRules:
    """When one phase becomes another, by the parameters `p`; see `node.models.segway`."""

    period: float
    p: Mapping[str, float]

    def advance(self, progress: Progress, e: Estimate, *, stand: bool) -> Progress:
        """The phase one period later; `stand` says whether it is told to stand."""
        goal = self._next(progress, e, stand=stand)
        if goal is not progress.doing:
            return Progress(phase=goal)
        return Progress(
            phase=progress.phase,
            elapsed=progress.elapsed + self.period,
            lasting=progress.lasting + self.period if self._is_ending(progress, e) else 0.0,
            wrong=progress.wrong + self.period if self._is_wrong(e) else 0.0,
        )

    def torque_down(self, e: Estimate) -> float:
        """Sum of torques while it sits down, N m: lean forward at a given rate; once down, stop rolling."""
        if abs(e.pitch) > _AT_STOP * self.p["StopPitch"] and abs(e.pitch_rate) < _LANDED_RATE:
            return -_BRAKE_GAIN * e.velocity
        p = self.p
        holding = p["TorquePerAcceleration"] / p["PitchPerAcceleration"] * e.pitch
        return holding - _RATE_FACTOR * p["PitchRateGain"] * (e.pitch_rate - p["SitDownRate"])

    def _next(self, progress: Progress, e: Estimate, *, stand: bool) -> Phase:
        match progress.doing:
            case Phase.RESTING:
                is_settled = min(e.since, progress.elapsed) > self.p["SettlingTime"]
                return Phase.STANDING_UP if stand and is_settled else Phase.RESTING
            case Phase.STANDING_UP:
                return self._from_standing_up(progress, stand=stand)
            case Phase.BALANCING:
                return self._from_balancing(progress, stand=stand)
            case Phase.SITTING_DOWN:
                is_over = progress.lasting > _STILL_TIME_S or progress.elapsed > self.p["SitDownTime"]
                return Phase.RESTING if is_over else Phase.SITTING_DOWN
            case Phase.GIVEN_UP:
                return Phase.GIVEN_UP if stand else Phase.RESTING

    def _from_standing_up(self, progress: Progress, *, stand: bool) -> Phase:
        if progress.elapsed > self.p["StandUpTime"] or progress.wrong > _RUNAWAY_TIME_S:
            return Phase.GIVEN_UP
        if not stand:
            return Phase.SITTING_DOWN
        return Phase.BALANCING if progress.lasting > _UP_TIME_S else Phase.STANDING_UP

    def _from_balancing(self, progress: Progress, *, stand: bool) -> Phase:
        if progress.lasting > self.p["FallTime"] or progress.wrong > _RUNAWAY_TIME_S:
            return Phase.GIVEN_UP
        return Phase.BALANCING if stand else Phase.SITTING_DOWN

    def _is_ending(self, progress: Progress, e: Estimate) -> bool:
        """Whether the robot is where its phase leads to, or has fallen while it balanced."""
        if progress.doing is Phase.STANDING_UP:
            return abs(e.pitch) < _UP_PITCH and abs(e.pitch_rate) < _UP_RATE
        is_down = abs(e.pitch) > _AT_STOP * self.p["StopPitch"]
        if progress.doing is Phase.BALANCING:
            return is_down
        return is_down and abs(e.velocity) < _STILL_SPEED and abs(e.pitch_rate) < _STILL_RATE

    def _is_wrong(self, e: Estimate) -> bool:
        """Whether the wheels turn faster than the robot is ever asked to go, as they do in the air."""
        return abs(e.velocity) > self.p["RunawaySpeed"]
