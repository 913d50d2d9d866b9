# SPDX-License-Identifier: MIT
"""What the runs of a robot tell of it, in words: value and interval of each quantity, and why an interval is wide."""

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from segway_ecc.hil.design.linear_model import Matrix
from segway_ecc.hil.design.segway import MOST_DELAY
from segway_ecc.hil.identify.fit import NORMAL_95, Fit, Fitter, OnPass
from segway_ecc.hil.identify.prediction import Predictor
from segway_ecc.hil.identify.quantities import Quantity, quantities
from segway_ecc.hil.identify.windows import Run, windows_of
from segway_ecc.node.models.segway_parameters import SegwayParameters
from segway_ecc.node.readable import short

_HARDLY_FOUND: Final = 0.7
"""Share of the deviation before that is left, from which on the runs count as showing nothing of it."""
_WIDE: Final = 0.1
"""Half width of an interval, as a share of the value, beyond which a reason is given."""
_TOGETHER: Final = 0.8
"""Correlation from which on two quantities are known together only."""
_MANY_OUTLIERS: Final = 0.25


class Origin(enum.StrEnum):
    """Where a value comes from."""

    RUNS = "found from the runs"
    BEFORE = "hardly to be found from the runs"


@dataclass(frozen=True, slots=True)
class Estimate:
    """One quantity as found.

    Attributes:
        known: What was taken for it before.
        least, most: Ends of the interval of 95 %.
        is_size: Whether its interval is a share of it.
        is_parameter: Whether the plant has it.
        together_with: Quantities that the runs hardly tell it from.
    """

    name: str
    unit: str
    known: float
    value: float
    least: float
    most: float
    is_size: bool
    is_parameter: bool
    origin: Origin
    together_with: tuple[str, ...]

    @property
    def half_width(self) -> float:
        """Of the interval; of a size, as a share of the value."""
        return 0.5 * math.log(self.most / self.least) if self.is_size else 0.5 * (self.most - self.least)

    @property
    def is_wide(self) -> bool:
        """Whether it is a size that is known to a tenth or worse."""
        return self.is_size and self.half_width > _WIDE

    @property
    def interval_text(self) -> str:
        """The half width, for a table."""
        return f"{100.0 * self.half_width:.1f} %" if self.is_size else short(float(f"{self.half_width:.2g}"))

    @property
    def remark(self) -> str:
        """Why the interval is wide, where it is."""
        if self.origin is Origin.BEFORE:
            return "the runs hardly tell it"
        if self.together_with and self.is_wide:
            return f"not told apart from {', '.join(self.together_with)}"
        return ""


class Identified(NamedTuple):
    """What was found, and what to know of it."""

    estimates: tuple[Estimate, ...]
    fit: Fit
    remarks: tuple[str, ...]


def identify(
    runs: Sequence[Run],
    p: SegwayParameters,
    *,
    voltage: bool,
    measured: Mapping[str, float] | None = None,
    on_pass: OnPass = lambda _done, _of: None,
) -> Identified:
    """Find what a robot is made of.

    Args:
        runs: What was recorded of it.
        p: What is taken to be known of it.
        voltage: Whether its drives are given a voltage, or a torque.
        measured: What was measured otherwise.
        on_pass: Called with how many passes are done, and how many there may be.

    Raises:
        ConfigurationError: The runs cannot be used, or there is nothing such as was measured.
    """
    sought = quantities(p, voltage=voltage, measured=measured)
    windows = windows_of(runs, radius=p.wheel_radius, stop_angle=p.stop_angle)
    fit = Fitter(Predictor(p, sought, voltage=voltage), sought, windows).fit(on_pass)
    return Identified(_estimates(fit), fit, _remarks(fit, runs[0].period_s))


def _estimates(fit: Fit) -> tuple[Estimate, ...]:
    deviations = np.sqrt(np.diag(fit.covariance))
    correlations: Matrix = fit.covariance / np.outer(deviations, deviations)
    return tuple(
        _estimate(q, float(fit.coordinates[i]), float(deviations[i]), _partners(fit, correlations, i))
        for i, q in enumerate(fit.quantities)
    )


def _partners(fit: Fit, correlations: Matrix, place: int) -> tuple[str, ...]:
    others = np.argsort(-np.abs(correlations[place]))
    return tuple(fit.quantities[i].name for i in others if i != place and abs(correlations[place, i]) > _TOGETHER)


def _estimate(q: Quantity, coordinate: float, deviation: float, together_with: tuple[str, ...]) -> Estimate:
    half = NORMAL_95 * deviation
    origin = Origin.BEFORE if deviation > _HARDLY_FOUND * q.deviation else Origin.RUNS
    least, most = q.value(coordinate - half), q.value(coordinate + half)
    return Estimate(
        q.name, q.unit, q.known, q.value(coordinate), least, most, q.is_size, q.is_parameter, origin, together_with
    )


def _remarks(fit: Fit, period_s: float) -> tuple[str, ...]:
    remarks = []
    if fit.outliers > _MANY_OUTLIERS:
        remarks.append(
            f"{100.0 * fit.outliers:.0f} % of the windows fit badly: the robot slipped, was held or touched something; "
            "the intervals do not cover that"
        )
    if not fit.converged:
        remarks.append(f"the fit has not settled after {fit.passes} passes: do not trust it")
    delay = fit.coordinates[[q.name for q in fit.quantities].index("Delay")]
    if delay > (MOST_DELAY + 0.5) * period_s:
        remarks.append(
            f"commands act {1e3 * delay:.1f} ms after their cycle, and the gains are designed for "
            f"{MOST_DELAY} periods, {1e3 * MOST_DELAY * period_s:g} ms: expect smaller margins"
        )
    return tuple(remarks)
