# SPDX-License-Identifier: MIT
"""What the model gives, against what the robot can do: values beyond it, a pose that jumps, commands that oscillate."""

import math
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from segway_ecc.node.errors import UnknownNameError
from segway_ecc.node.safety.settings import OscillationLimit, SafetySettings

_SPEED: Final = "odometry.linear_velocity"
_POSE: Final = ("odometry.x", "odometry.y")
JUMP_S: Final = 0.2
"""A pose may change in one cycle as far as the robot goes in this much more time, s: what was measured may have been
missing meanwhile, and an estimate catches up at once."""


class Given(NamedTuple):
    """Where among the model's outputs, or among what is computed of them, the value of a signal is, and its unit."""

    place: int
    unit: str


class OutputWatch:
    """Looks at the model's outputs in every cycle, before they leave.

    `fault` is what is wrong with the newest; None where nothing is.
    """

    def __init__(
        self, settings: SafetySettings, given: Mapping[str, Given], commands: Sequence[str], outputs: int
    ) -> None:
        """Watch the signals that a model gives, those of `commands` for oscillation too.

        Those whose place is not among its `outputs`, so many, are computed of these: they may be beyond all numbers.

        Raises:
            UnknownNameError: There is a limit of a signal that the model does not give.
        """
        limits = settings.output_limits or {}
        for name in limits:
            if name not in given:
                raise UnknownNameError("signal of safety.output_limits that an output of the model gives", name, given)
        self.fault: str | None = None
        self._bounds = [(given[name].place, bound, name) for name, bound in limits.items()]
        self._bounds += [
            (each.place, sys.float_info.max, name)
            for name, each in given.items()
            if each.place >= outputs and name not in limits
        ]
        self._given = given
        self._speed = limits.get(_SPEED)
        self._pose = [(name, given[name].place) for name in _POSE if name in given]
        self._last = dict.fromkeys(_POSE, math.nan)
        self._now_s = 0.0
        limit = settings.oscillation
        self._commands = [] if limit is None else [Reversals(name, given[name], limit) for name in commands]

    def restart(self) -> None:
        """The model starts anew: its pose may be anywhere. A fault stays until the next look."""
        self._last = dict.fromkeys(_POSE, math.nan)

    def look(self, y: Sequence[float], elapsed_s: float, *, is_active: bool) -> str | None:
        """Take the outputs `y`, all finite, so long after the last ones, s; what is wrong, if anything.

        What does not reach the motors, where the robot is not `is_active`, oscillates as it likes.
        """
        fault = self._jump(y, elapsed_s)
        for place, bound, name in self._bounds:
            if not -bound <= y[place] <= bound:
                value, unit = y[place], self._given[name].unit
                fault = f"the model gives {name} {value:.4g} {unit}, allowed is {-bound:g} to {bound:g} {unit}"
                break
        self._now_s += elapsed_s
        for command in self._commands:
            if is_active:
                fault = command.look(y, self._now_s) or fault
            else:
                command.clear()
        self.fault = fault
        return fault

    def _jump(self, y: Sequence[float], elapsed_s: float) -> str | None:
        """A pose that is further from the last one than the robot can have gone."""
        if self._speed is None:
            return None
        last, farthest, fault = self._last, self._speed * (elapsed_s + JUMP_S), None
        for name, place in self._pose:
            before, now = last[name], y[place]
            last[name] = now
            if abs(now - before) > farthest and fault is None:  # which nothing is from NaN
                fault = (
                    f"the model moves {name} from {before:.4g} to {now:.4g} m in {elapsed_s * 1e3:.0f} ms, allowed is "
                    f"{farthest:.3g} m at {self._speed:g} m/s"
                )
        return fault


class Reversals:
    """Counts how often one command changes its sign at a large amplitude."""

    def __init__(self, name: str, given: Given, limit: OscillationLimit) -> None:
        """Watch the output of a signal."""
        self._name = name
        self._place, self._unit = given
        self._limit = limit
        self._amplitude = limit.amplitude
        self._window_s = limit.window_s
        self._was_ahead: bool | None = None
        self._times: deque[float] = deque(maxlen=limit.in_window)

    def clear(self) -> None:
        """Discard everything."""
        self._was_ahead = None
        self._times.clear()

    def look(self, y: Sequence[float], now_s: float) -> str | None:
        """Take the outputs at a time, s; what is wrong, if anything."""
        value, amplitude = y[self._place], self._amplitude
        if -amplitude <= value <= amplitude:
            return None
        before, self._was_ahead = self._was_ahead, value > 0.0
        if before is None or before is self._was_ahead:
            return None
        times, limit = self._times, self._limit
        times.append(now_s)
        if len(times) < limit.in_window or now_s - times[0] >= self._window_s:
            return None
        return (
            f"{self._name} oscillates: it changed its sign {len(times)} times within {self._window_s:g} s, beyond "
            f"{amplitude:g} {self._unit} either way, fewer than {limit.in_window} are allowed"
        )
