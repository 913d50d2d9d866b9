# SPDX-License-Identifier: MIT
"""Fitting quantities to windows by output error, with intervals that count correlated residuals as what they are.

Each window has a start of its own (multiple shooting: Bock, "Recent Advances in Parameter Identification Techniques for
O.D.E.", 1983), which is eliminated from the normal equations. What is known before enters as in maximum a posteriori
estimation. Channels are weighed by the residuals that they leave, and a window that fits much worse than most, as where
a wheel slips or something touches, counts less. The covariance is the sandwich over blocks of windows (White, "Maximum
Likelihood Estimation of Misspecified Models", Econometrica 50, 1982), since residuals within a window belong together;
by as much as it exceeds the plain one, the data are taken to tell less.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from segway_ecc.hil.design.linear_model import Matrix
from segway_ecc.hil.identify.prediction import LOST, Predictor
from segway_ecc.hil.identify.quantities import Quantity, prior
from segway_ecc.hil.identify.windows import Windows

_START_DEVIATIONS: Final = np.array([0.5, 0.2, 0.2, 0.2, 0.01, 0.01])
"""Of a window's start: m/s, rad/s, rad/s, rad, rad, rad."""
_LEAST_DEVIATIONS: Final = np.array([2e-4, 2e-4, 2e-3, 2e-3, 2e-3, 0.02, 0.02, 0.02])
"""Of what the channels leave, rad, rad/s and m/s2: no encoder and no IMU is better, and no model of it."""
_FIRST_DEVIATIONS: Final = np.array([0.02, 0.02, 0.1, 0.1, 0.1, 1.0, 1.0, 1.0])
_REST_DEVIATION: Final = 1e-3
_MOST_PASSES: Final = 60
_HALVINGS: Final = 6
_CONVERGED: Final = 0.1
"""Of the largest change, in the standard deviations of the estimate."""
_GAINED: Final = 1.0
"""Of the sum of squares, which would grow by one for a change of one standard deviation."""
_LEAST_PASSES: Final = 4
_OUTLIER: Final = 4.0
"""Times the median of the windows' mean square."""
_MODEL_DEVIATION: Final = 0.0075
_LEFT_OUT: Final = {"CoulombFriction": 0.02, "ViscousFriction": 0.8, "BodyRollInertia": 0.1}
"""Of every parameter of the plant and of these, as shares, for what the equations leave out, which all windows have in
common.

Set by what was left on the robots of tests/hil/identify/test_unknown_robots.py. Viscous friction is a few hundredths of
the torque at ordinary speeds, where tyres have losses of the same order.
"""
_BLOCK: Final = 2
_STEP: Final = 1e-4
"""For slopes by differences."""
_TIME_STEP_S: Final = 5e-4
"""The same for a delay: longer, since commands change in steps."""
NORMAL_95: Final = 1.96

OnPass = Callable[[int, int], None]


class Fit(NamedTuple):
    """What was found.

    Attributes:
        quantities: What was identified.
        coordinates: Of each, as found.
        covariance: Of the coordinates.
        deviations: Of the residuals of each channel.
        inflation: By how much more the scores vary from window to window than white residuals would have them.
        outliers: Share of the windows that fit too badly to count in full.
        windows: How many were used.
        passes: How many it took.
        converged: Whether the last one changed next to nothing.
    """

    quantities: tuple[Quantity, ...]
    coordinates: Matrix
    covariance: Matrix
    deviations: Matrix
    inflation: float
    outliers: float
    windows: int
    passes: int
    converged: bool


class _Normal(NamedTuple):
    """One linearization: per window the information, the score, and what follows for its start."""

    information: Matrix
    score: Matrix
    start_gain: Matrix
    start_step: Matrix


class Fitter:
    """Finds quantities in windows."""

    def __init__(self, predictor: Predictor, quantities: Sequence[Quantity], windows: Windows) -> None:
        """Take a robot with what is known of it, and the windows."""
        self._predictor, self._windows, self._quantities = predictor, windows, tuple(quantities)
        self._known, self._spread = prior(quantities)
        bounds = np.array([q.bounds for q in quantities])
        self._least, self._most = bounds[:, 0], bounds[:, 1]
        self._bias = [i for i, q in enumerate(quantities) if q.name.startswith("GyroBias")]
        self._sizes = np.array([q.is_size for q in quantities])
        self._left_out = np.array(
            [
                _LEFT_OUT.get(q.name, _MODEL_DEVIATION) * (1.0 if q.is_size else abs(q.known)) * q.is_parameter
                for q in quantities
            ]
        )
        self._steps = np.array([_TIME_STEP_S if q.unit == "s" else _STEP for q in quantities])
        self._shown = np.broadcast_to(windows.mask[..., None], windows.measured.shape).copy()
        self._shown[:, :LOST, 2:] = 0.0

    def fit(self, on_pass: OnPass = lambda _done, _of: None) -> Fit:
        """Find them."""
        theta, start = self._known.copy(), self._windows.start.copy()
        deviations, weights = _FIRST_DEVIATIONS, np.ones(len(start), dtype=np.float64)
        passes, converged = 0, False
        for passes in range(1, _MOST_PASSES + 1):
            on_pass(passes, _MOST_PASSES)
            normal = self._linearize(theta, start, deviations)
            information, score = self._sums(normal, weights, theta)
            change: Matrix = np.asarray(np.linalg.solve(information, score), dtype=np.float64)
            theta, start, gained = self._move(theta, start, normal, change, deviations, weights)
            residuals = self._residuals(theta, start)
            deviations, weights = self._judge(residuals)
            converged = bool(np.abs(change / np.sqrt(np.diag(np.linalg.inv(information)))).max() < _CONVERGED)
            converged = converged or (gained < _GAINED and passes > _LEAST_PASSES)
            if converged:
                break
        normal = self._linearize(theta, start, deviations)
        covariance, inflation = self._covariance(normal, weights)
        covariance += np.diag(self._left_out**2)
        outliers = float((weights < 1.0).mean())
        return Fit(self._quantities, theta, covariance, deviations, inflation, outliers, len(start), passes, converged)

    def information(self, theta: Matrix, deviations: Matrix) -> Matrix:
        """What these windows tell at given quantities, without what is known before."""
        normal = self._linearize(theta, self._windows.start, deviations)
        found = normal.information.sum(axis=0)
        found[self._bias, self._bias] += len(self._windows.rest) / _REST_DEVIATION**2
        return np.asarray(found)

    def _residuals(self, theta: Matrix, start: Matrix) -> Matrix:
        predicted = self._predictor.predict(theta[None], self._windows, start[None])[0]
        return np.asarray((self._windows.measured - predicted) * self._shown)

    def _linearize(self, theta: Matrix, start: Matrix, deviations: Matrix) -> _Normal:
        count, states = len(theta), start.shape[1]
        steps = np.concatenate([self._steps, np.full(states, _STEP)])
        sets = np.repeat(theta[None], 1 + count + states, axis=0)
        starts = np.repeat(start[None], 1 + count + states, axis=0)
        for place in range(count):
            sets[1 + place, place] += steps[place]
        for place in range(states):
            starts[1 + count + place, :, place] += steps[count + place]
        predicted = self._predictor.predict(sets, self._windows, starts)
        scale = self._shown / deviations
        slopes = (predicted[1:] - predicted[0]) / steps[:, None, None, None] * scale
        windows = len(start)
        jacobian = np.moveaxis(slopes.reshape(count + states, windows, -1), 0, 2)
        residual = ((self._windows.measured - predicted[0]) * scale).reshape(windows, -1)
        of_theta, of_start = jacobian[..., :count], jacobian[..., count:]
        prior_rows = np.diag(_START_DEVIATIONS**-2.0)
        transposed = np.swapaxes(of_start, 1, 2)
        inverse = np.linalg.inv(transposed @ of_start + prior_rows)
        off = (transposed @ residual[..., None])[..., 0] + (self._windows.start - start) @ prior_rows
        cross = transposed @ of_theta
        gain = inverse @ cross
        step = (inverse @ off[..., None])[..., 0]
        turned = np.swapaxes(of_theta, 1, 2)
        information = turned @ of_theta - np.swapaxes(cross, 1, 2) @ gain
        score = (turned @ residual[..., None])[..., 0] - (np.swapaxes(cross, 1, 2) @ step[..., None])[..., 0]
        return _Normal(information, score, gain, step)

    def _sums(self, normal: _Normal, weights: Matrix, theta: Matrix) -> tuple[Matrix, Matrix]:
        information = np.einsum("w,wij->ij", weights, normal.information) + np.diag(self._spread**-2.0)
        score = weights @ normal.score + (self._known - theta) * self._spread**-2.0
        for axis, place in enumerate(self._bias):
            information[place, place] += len(self._windows.rest) / _REST_DEVIATION**2
            score[place] += (self._windows.rest[:, axis] - theta[place]).sum() / _REST_DEVIATION**2
        return information, score

    def _move(  # noqa: PLR0913, PLR0917 - where it is, where it would go, and how that is weighed
        self, theta: Matrix, start: Matrix, normal: _Normal, change: Matrix, deviations: Matrix, weights: Matrix
    ) -> tuple[Matrix, Matrix, float]:
        """Go as far as it gets better, no size by more than its deviation before; also by how much it did."""
        before = self._cost(theta, start, deviations, weights)
        share = 1.0 / max(1.0, float(np.abs(change / self._spread)[self._sizes].max()))
        for _ in range(_HALVINGS):
            tried = np.clip(theta + share * change, self._least, self._most)
            moved = start + share * normal.start_step - np.einsum("wij,j->wi", normal.start_gain, tried - theta)
            after = self._cost(tried, moved, deviations, weights)
            if after <= before:
                return tried, moved, before - after
            share *= 0.5
        return theta, start, 0.0

    def _cost(self, theta: Matrix, start: Matrix, deviations: Matrix, weights: Matrix) -> float:
        squares = (self._residuals(theta, start) / deviations) ** 2
        off = ((start - self._windows.start) / _START_DEVIATIONS) ** 2
        rest = ((self._windows.rest - theta[self._bias]) / _REST_DEVIATION) ** 2
        known = ((theta - self._known) / self._spread) ** 2
        total = float(weights @ (squares.sum(axis=(1, 2)) + off.sum(axis=1)) + rest.sum() + known.sum())
        return total if np.isfinite(total) else np.inf

    def _judge(self, residuals: Matrix) -> tuple[Matrix, Matrix]:
        """The channels' deviations, by the median over the windows, and the windows' weights."""
        counts = self._shown.sum(axis=1)
        means = (residuals**2).sum(axis=1) / np.maximum(counts, 1.0)
        deviations = np.maximum(np.sqrt(np.median(means, axis=0)), _LEAST_DEVIATIONS)
        badness = (means / deviations**2).mean(axis=1)
        limit = _OUTLIER * np.median(badness)
        return deviations, np.minimum(1.0, limit / np.maximum(badness, 1e-12))

    def _covariance(self, normal: _Normal, weights: Matrix) -> tuple[Matrix, float]:
        plain = np.einsum("w,wij->ij", weights, normal.information)
        scores = weights[:, None] * normal.score
        blocks = [scores[i : i + _BLOCK].sum(axis=0) for i in range(0, len(scores), _BLOCK)]
        meat = np.array(blocks).T @ np.array(blocks)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(plain), 1e-12))
        inflation = max(1.0, float(np.mean(np.diag(meat) * scale**2)))
        known = np.diag(self._spread**-2.0)
        known[self._bias, self._bias] += len(self._windows.rest) / _REST_DEVIATION**2
        inverse = np.linalg.inv(plain / inflation + known)
        covariance = inverse @ (meat / inflation**2 + known) @ inverse
        # Few blocks can look better than what they tell: never less than the inflated information has.
        larger = np.sqrt(np.maximum(np.diag(inverse) / np.diag(covariance), 1.0))
        return np.asarray(covariance * np.outer(larger, larger)), inflation
