# SPDX-License-Identifier: MIT
"""A log beside the simulation of its commands: what differs, signal by signal."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from segway_ecc.hil.comparison.logged import PITCH, Array, LoggedRun
from segway_ecc.hil.comparison.simulated import LoggedPlant, Window, pieces_of
from segway_ecc.hil.errors import PlantMismatchError
from segway_ecc.hil.plants.segway_hardware import BANDWIDTH
from segway_ecc.hil.progress import OnProgress
from segway_ecc.node.model.model import Model

DEFAULT_WINDOW_S: Final = 0.25
"""Of a robot that balances: an error grows in it by a factor of about 10, in twice that by 100."""
_LONGEST_DELAY_S: Final = 0.01
_SEARCHED: Final = 12
"""Pieces in which the delay is looked for: those in which most moves."""
_TRIED_OFFSET: Final = 0.01
_LEAST_SPREAD: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Residual:
    """What differs in one signal, in its unit: logged less simulated.

    Attributes:
        rms: Root of the mean square.
        largest: Of largest magnitude.
        largest_at_s: When that was, s since the log's first cycle.
        mean: Over all of it.
        spread: Standard deviation of the logged signal.
        noise: That of the sensor by the plant's parameters; None where the plant has none.
    """

    name: str
    unit: str
    rms: float
    largest: float
    largest_at_s: float
    mean: float
    spread: float
    noise: float | None

    @property
    def relative(self) -> float:
        """The RMS residual as a share of the signal's spread; infinite where the signal did not change."""
        return self.rms / self.spread if self.spread > _LEAST_SPREAD else math.inf


@dataclass(frozen=True, slots=True)
class Comparison:
    """What came of it.

    Attributes:
        run: What was logged.
        plant: The name of the plant.
        simulated: Each signal as simulated, shape (n,); NaN where nothing was.
        pieces: What was simulated together.
        window_s: How long each is, s; None where the run is simulated in one.
        begins_as_logged: Whether each begins in the logged motion; else as the plant always does.
        delay_s: From when a command is sent until the motors have it, s.
        pitch_offset: How much further than logged the body leans at the beginnings, rad.
        residuals: By signal.
    """

    run: LoggedRun
    plant: str
    simulated: Mapping[str, Array]
    pieces: Sequence[Window]
    window_s: float | None
    begins_as_logged: bool
    delay_s: float
    pitch_offset: float
    residuals: Sequence[Residual]


def compare(
    run: LoggedRun, plant: Model, window_s: float | None, delay_s: float | None, on_progress: OnProgress
) -> Comparison:
    """Simulate the commands of a run.

    Args:
        run: What was logged.
        plant: What is to show the same.
        window_s: How long each piece is, s; None for `DEFAULT_WINDOW_S` where the plant balances, else a whole run.
        delay_s: From when a command is sent until the motors have it, s; None for that with which least differs.
        on_progress: Called with how many passes of the simulation are done, and of how many.

    Raises:
        PlantMismatchError: The plant does not fit the log, or the log is too short.
    """
    logged = LoggedPlant(plant, run)
    if window_s is None and logged.balances and logged.can_begin_anywhere:
        window_s = DEFAULT_WINDOW_S
    pieces = pieces_of(run, window_s if logged.can_begin_anywhere else None)
    if not pieces:
        raise PlantMismatchError("the log has no stretch without a gap that is as long as a window; give --window")
    step_s = plant.step_size
    delays = [step_s * count for count in range(round(_LONGEST_DELAY_S / step_s) + 1)] if delay_s is None else [delay_s]
    lively = _lively(run, pieces) if len(delays) > 1 else []
    costs = []
    for done, delay in enumerate(delays if lively else ()):
        on_progress(done, len(delays) + 1)
        offset = _offset(logged, run, lively, delay)
        costs.append(_cost(run, logged.simulate(lively, delay, offset)))
    chosen = delays[int(np.argmin(costs))] if costs else delays[0]
    offset = _offset(logged, run, pieces, chosen)
    found = logged.simulate(pieces, chosen, offset)
    on_progress(len(delays) + 1, len(delays) + 1)
    return Comparison(
        run=run,
        plant=plant.name,
        simulated=found,
        pieces=pieces,
        window_s=window_s if logged.can_begin_anywhere else None,
        begins_as_logged=logged.can_begin_anywhere,
        delay_s=chosen,
        pitch_offset=offset,
        residuals=list(_residuals(run, logged, plant, found)),
    )


def _offset(logged: LoggedPlant, run: LoggedRun, pieces: Sequence[Window], delay_s: float) -> float:
    """The offset of the logged pitch, rad, with which the wheels differ least: an accelerometer that is off leaves one.

    By least squares of what it changes, taken to be in proportion to it.
    """
    if not logged.balances or not logged.can_begin_anywhere or PITCH not in run.values:
        return 0.0
    without, with_it = (logged.simulate(pieces, delay_s, offset) for offset in (0.0, _TRIED_OFFSET))
    product = square = 0.0
    for name in _wheels(without):
        slope, weight = (with_it[name] - without[name]) / _TRIED_OFFSET, _weight(run.values[name])
        product += float(np.nansum(slope * (run.values[name] - without[name]))) * weight
        square += float(np.nansum(slope * slope)) * weight
    return product / square if square > 0.0 else 0.0


def _weight(values: Array) -> float:
    spread = float(np.std(values))
    return 1.0 / spread**2 if spread > _LEAST_SPREAD else 0.0


def _cost(run: LoggedRun, found: Mapping[str, Array]) -> float:
    """What differs in the wheels, each signal by its spread."""
    costs = (np.nanmean((run.values[name] - found[name]) ** 2) * _weight(run.values[name]) for name in _wheels(found))
    return float(sum(costs))


def _wheels(found: Mapping[str, Array]) -> list[str]:
    """What the encoders measure: unlike an IMU they have no bias, which would be taken for something else."""
    return [name for name in found if name.endswith((".angle", ".velocity"))]


def _lively(run: LoggedRun, pieces: Sequence[Window]) -> list[Window]:
    """The pieces in which the commands change most."""

    def change(piece: Window) -> float:
        return float(np.sum(np.abs(np.diff(run.commands[piece.first : piece.end], axis=0))))

    return sorted(sorted(pieces, key=change)[-_SEARCHED:], key=lambda piece: piece.first)


def _residuals(run: LoggedRun, logged: LoggedPlant, plant: Model, found: Mapping[str, Array]) -> Iterator[Residual]:
    for name, (_, unit) in logged.compared.items():
        residual = run.values[name] - found[name]
        at = int(np.nanargmax(np.abs(residual)))
        yield Residual(
            name=name,
            unit=unit,
            rms=float(np.sqrt(np.nanmean(residual**2))),
            largest=float(residual[at]),
            largest_at_s=float(run.starts[at]),
            mean=float(np.nanmean(residual)),
            spread=float(np.std(run.values[name][~np.isnan(residual)])),
            noise=_noise(plant, name),
        )


def _noise(plant: Model, signal: str) -> float | None:
    """The standard deviation of a sensor's noise by the default parameters of a plant; None where it has none.

    Counts are taken to be rounded evenly. What the first-order filter with the gain g leaves of the differences of
    values with the standard deviation s is s g sqrt(2 / (2 - g)).
    """
    values = {v.name: v.value for v in plant.parameters}
    device, _, quantity = signal.partition(".")
    if device == "imu":
        density = values.get("GyroNoise" if quantity.startswith("angular") else "AccelerometerNoise")
        return None if density is None else density * math.sqrt(min(0.5 / plant.step_size, BANDWIDTH))
    counts, filter_s = values.get("EncoderCountsPerTurn"), values.get("EncoderFilterTime")
    if not counts or filter_s is None or quantity not in {"angle", "velocity"}:
        return None
    rounding = 2.0 * math.pi / counts / math.sqrt(12.0)
    gain = plant.step_size / (plant.step_size + filter_s)
    return rounding if quantity == "angle" else rounding * gain * math.sqrt(2.0 / (2.0 - gain)) / plant.step_size
