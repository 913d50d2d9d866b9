# SPDX-License-Identifier: MIT
"""Least squares with forgetting: against numpy, and what the prior and the forgetting do."""

import numpy as np
import pytest

from segway_ecc.node.safety.forgetting_fit import LineFit, PlaneFit


def samples(count: int) -> np.ndarray:
    return np.random.default_rng(4).normal(size=(count, 3))


def test_a_plane_is_found_as_by_weighted_least_squares_with_the_prior_as_samples() -> None:
    kept, priors = 0.99, (2.0, 3.0, 5.0)
    fit, data = PlaneFit(kept, priors), samples(200)
    for x, z, noise in data:
        fit.add(x, z, 0.7 * x - 0.2 + 1.3 * z + 0.1 * noise)
    x, z, noise = data.T
    y, weights = 0.7 * x - 0.2 + 1.3 * z + 0.1 * noise, kept ** np.arange(199, -1, -1)
    features = np.stack([x, np.ones_like(x), z], axis=1)
    wanted = np.linalg.solve((features.T * weights) @ features + np.diag(priors), (features.T * weights) @ y)
    assert fit.solve() == pytest.approx(wanted, rel=1e-9)


def test_a_line_is_found_whatever_its_offset() -> None:
    fit = LineFit(1.0, 0.0)
    for x, offset, _ in samples(50):
        fit.add(x, -0.4 * x + 7.0 + 0.0 * offset)
    assert fit.is_known
    assert fit.solve() == pytest.approx(-0.4)


def test_a_line_is_found_as_by_weighted_least_squares_with_the_prior_as_samples_of_its_slope() -> None:
    kept, prior = 0.9, 2.0
    fit, data = LineFit(kept, prior), samples(40)
    for x, noise, _ in data:
        fit.add(x + 1.0, 0.7 * x - 0.2 + noise)
    x, noise, _ = data.T
    weights = kept ** np.arange(39, -1, -1)
    features = np.stack([x + 1.0, np.ones_like(x)], axis=1)
    normal = (features.T * weights) @ features + np.diag((prior, 0.0))
    wanted = np.linalg.solve(normal, (features.T * weights) @ (0.7 * x - 0.2 + noise))
    assert fit.solve() == pytest.approx(wanted[0], rel=1e-9)


@pytest.mark.parametrize(
    ("xs", "prior", "is_known"),
    [((-1.0, 1.0), 1.0, False), ((-1.0, 1.0), 0.99, True), ((3.0, 5.0), 1.5, False), ((9.0,), 0.1, False)],
)
def test_a_slope_is_known_where_samples_weigh_more_than_twice_the_prior(
    xs: tuple[float, ...], prior: float, *, is_known: bool
) -> None:
    fit = LineFit(1.0, prior)
    for x in xs:
        fit.add(x, 2.0 * x)
    assert fit.is_known is is_known
    assert (fit.solve() == 0.0) is (len(xs) == 1)


def test_without_samples_there_is_no_deviation() -> None:
    assert LineFit(0.99, 1.0).solve() == 0.0
    assert not LineFit(0.99, 1.0).is_known
    assert PlaneFit(0.99, (1.0, 1.0, 1.0)).solve() == (0.0, 0.0, 0.0)


def test_where_nothing_moves_the_estimate_goes_back_to_none_and_does_not_wind_up() -> None:
    fit = LineFit(0.99, 1.0)
    for x, _, _ in samples(500):
        fit.add(x, 2.0 * x)
    assert fit.solve() == pytest.approx(2.0, abs=0.05)
    for _ in range(100_000):
        fit.add(0.0, 1e-3)
    assert abs(fit.solve()) < 1e-6


def test_what_was_seen_long_ago_is_forgotten() -> None:
    fit = LineFit(0.99, 1.0)
    for slope in (2.0, -1.0):
        for x, _, _ in samples(1000):
            fit.add(x, slope * x)
    assert fit.solve() == pytest.approx(-1.0, abs=0.05)
