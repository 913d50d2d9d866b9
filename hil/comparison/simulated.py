# SPDX-License-Identifier: MIT
"""The plant under the commands of a log, in pieces that each begin in the logged motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from segway_ecc.hil.comparison.logged import PITCH, Array, LoggedRun
from segway_ecc.hil.errors import PlantMismatchError
from segway_ecc.hil.plants.placing import Placeable, WheelMotion
from segway_ecc.node.model.model import Model

TRUE_PITCH: Final = "truth.pitch"
_ANGLES: Final = ("left.angle", "right.angle")
_LATENCY: Final = "ImuLatency"
_HALF_SPAN: Final = 2
"""Periods to either side over which angles give a velocity: encoders count, and their own filters are late."""
_LEAST_CYCLES: Final = 2 * _HALF_SPAN + 2
_NO_ERRORS: Final = (
    *(f"Gyro{kind}" for kind in ("Noise", "Bias", "Scale")),
    *(f"Accelerometer{kind}" for kind in ("Noise", "Bias", "Scale")),
)
"""Parameters of a plant that are zero here: what it draws by chance is not what the robot's sensors have."""


@dataclass(frozen=True, slots=True)
class Window:
    """Some cycles that are simulated together: the place of the first in the run, and the one behind the last."""

    first: int
    end: int


def pieces_of(run: LoggedRun, window_s: float | None) -> list[Window]:
    """The pieces of a run, each `window_s` long, s; None for whole stretches. What is left at an end is left out."""
    cycles = None if window_s is None else max(round(window_s / run.period_s), _LEAST_CYCLES)
    pieces = []
    for begin, end in run.stretches:
        first, last = begin + _HALF_SPAN, end - _HALF_SPAN
        length = last - first if cycles is None else cycles
        if length >= _LEAST_CYCLES:
            pieces += [Window(at, at + length) for at in range(first, last - length + 1, length)]
    return pieces


class LoggedPlant:
    """A plant that is given the commands of a log.

    Attributes:
        compared: The signals that log and plant both have, each with the plant's output and its unit.
    """

    def __init__(self, plant: Model, run: LoggedRun) -> None:
        """Stand a plant, without errors of its sensors, behind the commands of a run.

        Raises:
            PlantMismatchError: It takes other inputs than the log has commands, or has no outputs in common with it.
        """
        self._plant, self._run = plant, run
        names, outputs = [v.name for v in plant.inputs], {v.name: v.unit for v in plant.outputs}
        if sorted(names) != sorted(run.command_names):
            takes, has = ", ".join(names) or "nothing", ", ".join(run.command_names)
            raise PlantMismatchError(f"plant '{plant.name}' takes {takes}; the log has the commands {has}")
        self._commands = run.commands[:, [run.command_names.index(name) for name in names]]
        self.compared = {name: (name, outputs[name]) for name in run.values if name in outputs}
        if PITCH in run.values and TRUE_PITCH in outputs:
            self.compared[PITCH] = (TRUE_PITCH, outputs[TRUE_PITCH])
        if not self.compared:
            raise PlantMismatchError(f"plant '{plant.name}' has no output that the log has a signal for")
        lacks = [name for name in _ANGLES if name not in run.values]
        if lacks and self.can_begin_anywhere:
            raise PlantMismatchError(f"the log has no {', '.join(lacks)}, which the start of a plant is made of")
        self._columns = [list(outputs).index(output) for output, _ in self.compared.values()]
        parameters = {v.name for v in plant.parameters}
        for name in parameters.intersection(_NO_ERRORS):
            plant.write(name, 0.0)
        self._imu_latency = plant.read(_LATENCY) if _LATENCY in parameters else 0.0
        self._tracks = {name: _Track(run.times[name], run.values[name]) for name in run.values}

    @property
    def balances(self) -> bool:
        """Whether the plant is one that falls without control: it must begin anew, again and again."""
        return any(v.name == TRUE_PITCH for v in self._plant.outputs)

    @property
    def can_begin_anywhere(self) -> bool:
        """Whether the plant can be started in a motion; else it begins as it always does."""
        return isinstance(self._plant, Placeable)

    def simulate(self, pieces: Sequence[Window], delay_s: float, pitch_offset: float = 0.0) -> Mapping[str, Array]:
        """Each compared signal at the cycles of a run, shape (n,), SI; NaN outside of the pieces.

        Args:
            pieces: What to simulate.
            delay_s: From when a command is sent until the motors have it, s.
            pitch_offset: How much further than logged the body leans at the beginning of each piece, rad.
        """
        found = {name: np.full(len(self._run.cycles), np.nan) for name in self.compared}
        for piece in pieces:
            self._simulate(piece, delay_s, pitch_offset, found)
        return found

    def _simulate(self, piece: Window, delay_s: float, pitch_offset: float, found: Mapping[str, Array]) -> None:
        run, plant = self._run, self._plant
        step, begin = plant.step_size, min(float(run.times[name][piece.first]) for name in self.compared)
        end = max(float(run.times[name][piece.end - 1]) for name in self.compared)
        times = begin + step * np.arange(int(np.ceil((end - begin) / step)) + 1)
        sent = run.starts[max(piece.first - _HALF_SPAN, 0) : piece.end] + delay_s
        # What acts in the middle of a step acts in all of it.
        places = np.searchsorted(sent, times + 0.5 * step, side="right") - 1
        u = self._commands[np.maximum(places, 0) + max(piece.first - _HALF_SPAN, 0)].tolist()
        shown = [plant.initialize(u[0])]
        if isinstance(plant, Placeable):
            shown = [list(plant.begin_at(self._motion(begin, pitch_offset), u[0]))]
        shown += [plant.step(each) for each in u[:-1]]
        curves = np.array(shown)[:, self._columns]
        window = slice(piece.first, piece.end)
        for place, name in enumerate(self.compared):
            late = self._imu_latency if name == PITCH else 0.0  # an estimate is as old as what it is made of
            found[name][window] = np.interp(run.times[name][window] - late, times, curves[:, place])

    def _motion(self, time: float, pitch_offset: float) -> WheelMotion:
        """The motion that was logged at a time; what the IMU shows of it arrived later."""
        span, tracks = _HALF_SPAN * self._run.period_s, self._tracks
        wheels = [tracks[name] for name in _ANGLES]
        (left, left_rate), (right, right_rate) = (track.motion_at(time, span) for track in wheels)
        if PITCH not in tracks or not self.balances:
            return WheelMotion(left, left_rate, right, right_rate)
        # Its rate is the gyro's without the bias that the estimate takes off.
        pitch, pitch_rate = tracks[PITCH].motion_at(time + self._imu_latency, span)
        return WheelMotion(left, left_rate, right, right_rate, pitch + pitch_offset, pitch_rate)


class _Track:
    """A signal over time, s."""

    def __init__(self, times: Array, values: Array) -> None:
        is_new = np.diff(times, prepend=-np.inf) > 0.0  # what did not arrive anew is shown again
        self._times, self._values = times[is_new], values[is_new]

    def motion_at(self, time: float, span: float) -> tuple[float, float]:
        """The value at a time, between those that arrived, and how fast it changes from `span` before to after it."""
        before, value, after = np.interp((time - span, time, time + span), self._times, self._values).tolist()
        return value, (after - before) / (2.0 * span)
