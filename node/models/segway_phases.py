# SPDX-License-Identifier: MIT
"""What a segway is doing: resting on a stop, standing up, balancing, sitting down, or resting because it gave up."""

import enum
from collections.abc import Mapping
from typing import Final

from segway_ecc.firmware_io.value import Value
from segway_ecc.node.models.segway_estimate import Estimate

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
    """Down, the motors give nothing; stands up on request."""
    STANDING_UP = 1
    """On its way from the stop to balance."""
    BALANCING = 2
    """Up, and following set-points."""
    SITTING_DOWN = 3
    """Leaning down onto the stop ahead, then braking."""
    GIVEN_UP = 4
    """Down, the motors give nothing; it fell or did not get up; tries again after a request to sit."""


class PhaseProgress(Value, frozen=True):
    """A phase, and how far it has come.

    Attributes:
        phase: The phase.
        elapsed: How long it has lasted, s.
        lasting: How long the robot has been where the phase leads, or ends, s.
        wrong: How long the wheels have been too fast, s.
    """

    phase: Phase = Phase.RESTING
    elapsed: float = 0.0
    lasting: float = 0.0
    wrong: float = 0.0

    @property
    def is_resting(self) -> bool:
        """Whether the motors give nothing."""
        return self.phase is Phase.RESTING or self.phase is Phase.GIVEN_UP


class PhaseRules:
    """When one phase becomes another."""

    def __init__(self, period: float, p: Mapping[str, float]) -> None:
        """Take the parameters `p` of `segway_ecc.node.models.segway`, and the period, s."""
        self._period = period
        self._settling_time = p["SettlingTime"]
        self._stand_up_time = p["StandUpTime"]
        self._fall_time = p["FallTime"]
        self._sit_down_time = p["SitDownTime"]
        self._sit_down_rate = p["SitDownRate"]
        self._down_pitch = _AT_STOP * p["StopPitch"]
        self._runaway_speed = p["RunawaySpeed"]
        self._torque_per_pitch = p["TorquePerAcceleration"] / p["PitchPerAcceleration"]
        self._torque_per_rate = _RATE_FACTOR * p["PitchRateGain"]

    def advance(self, progress: PhaseProgress, e: Estimate, *, stand: bool) -> PhaseProgress:
        """The phase one period later; `stand` is whether it is asked to stand."""
        phase, period = progress.phase, self._period
        goal = self._next(progress, e, stand=stand)
        if goal is not phase:
            return PhaseProgress(goal)
        return PhaseProgress(
            phase,
            progress.elapsed + period,
            progress.lasting + period if self._is_ending(phase, e) else 0.0,
            # Faster than the robot is ever asked to go, as wheels turn in the air.
            progress.wrong + period if abs(e.velocity) > self._runaway_speed else 0.0,
        )

    def torque_down(self, e: Estimate) -> float:
        """Sum of torques while it sits down, N m: lean forward at a given rate; once down, stop rolling."""
        if abs(e.pitch) > self._down_pitch and abs(e.pitch_rate) < _LANDED_RATE:
            return -_BRAKE_GAIN * e.velocity
        return self._torque_per_pitch * e.pitch - self._torque_per_rate * (e.pitch_rate - self._sit_down_rate)

    def _next(self, progress: PhaseProgress, e: Estimate, *, stand: bool) -> Phase:
        match progress.phase:
            case Phase.BALANCING:  # for nearly all of its time, and so asked for first
                if progress.lasting > self._fall_time or progress.wrong > _RUNAWAY_TIME_S:
                    return Phase.GIVEN_UP
                return Phase.BALANCING if stand else Phase.SITTING_DOWN
            case Phase.RESTING:
                is_settled = min(e.since, progress.elapsed) > self._settling_time
                return Phase.STANDING_UP if stand and is_settled else Phase.RESTING
            case Phase.STANDING_UP:
                return self._from_standing_up(progress, stand=stand)
            case Phase.SITTING_DOWN:
                is_over = progress.lasting > _STILL_TIME_S or progress.elapsed > self._sit_down_time
                return Phase.RESTING if is_over else Phase.SITTING_DOWN
            case Phase.GIVEN_UP:
                return Phase.GIVEN_UP if stand else Phase.RESTING

    def _from_standing_up(self, progress: PhaseProgress, *, stand: bool) -> Phase:
        if progress.elapsed > self._stand_up_time or progress.wrong > _RUNAWAY_TIME_S:
            return Phase.GIVEN_UP
        if not stand:
            return Phase.SITTING_DOWN
        return Phase.BALANCING if progress.lasting > _UP_TIME_S else Phase.STANDING_UP

    def _is_ending(self, phase: Phase, e: Estimate) -> bool:
        """Whether the robot is where its phase leads to, or has fallen while it balanced."""
        if phase is Phase.STANDING_UP:
            return abs(e.pitch) < _UP_PITCH and abs(e.pitch_rate) < _UP_RATE
        is_down = abs(e.pitch) > self._down_pitch
        if phase is Phase.BALANCING:
            return is_down
        return is_down and abs(e.velocity) < _STILL_SPEED and abs(e.pitch_rate) < _STILL_RATE
