# SPDX-License-Identifier: MIT
"""Margins against closed forms, and against the poles of the loop with as much more gain or delay."""

import math

import numpy as np
import pytest

from segway_ecc.hil.design.linear_model import LinearModel, Matrix, discretise, lqr, margins, with_delay

PERIOD = 0.01
PENDULUM = discretise(LinearModel(np.array([[0.0, 1.0], [9.0, 0.0]]), np.array([[0.0], [1.0]])), PERIOD)
Q, R = np.diag([400.0, 25.0]), np.array([[1.0]])


def radius(gain: Matrix, known: int, factor: float = 1.0, later: int = 0) -> float:
    """Largest pole with the robot's gain times `factor` and its input `later` periods more; the controller as it is."""
    model = with_delay(LinearModel(PENDULUM.a, PENDULUM.b * factor), known + later)
    k = np.zeros((1, len(model.a)))
    k[0, : 2 + known] = gain
    return float(max(abs(np.linalg.eigvals(model.a - model.b @ k))))


def test_of_an_integrator_with_gain_all_is_known() -> None:
    # L(z) = k T / (z - 1): stable for k T < 2; it crosses one where 2 sin(w T / 2) = k T,
    # with 90 degrees + w T / 2 of lag.
    model = LinearModel(np.array([[1.0]]), np.array([[PERIOD]]))
    found = margins(model, np.array([[20.0]]), PERIOD)
    crossover = 2.0 / PERIOD * math.asin(0.1)
    phase = math.pi / 2.0 - crossover * PERIOD / 2.0
    assert found.gain_up == pytest.approx(10.0, rel=1e-3)
    assert found.gain_down == 0.0
    assert found.crossover_rad_s == pytest.approx(crossover, rel=1e-5)
    assert found.phase_rad == pytest.approx(phase, rel=1e-5)
    assert found.delay_s == pytest.approx(phase / crossover, rel=1e-5)


@pytest.mark.parametrize("known", [0, 1, 2])
def test_the_loop_turns_unstable_at_the_gain_margins(known: int) -> None:
    model = with_delay(PENDULUM, known)
    q = np.zeros_like(model.a)
    q[:2, :2] = Q
    gain = lqr(model, q, R)
    found = margins(PENDULUM, gain, PERIOD)
    assert radius(gain, known, 0.99 * found.gain_up) < 1.0 < radius(gain, known, 1.01 * found.gain_up)
    assert radius(gain, known, 1.01 * found.gain_down) < 1.0 < radius(gain, known, 0.99 * found.gain_down)


@pytest.mark.parametrize("known", [0, 1, 2])
def test_the_loop_turns_unstable_at_the_delay_margin(known: int) -> None:
    model = with_delay(PENDULUM, known)
    q = np.zeros_like(model.a)
    q[:2, :2] = Q
    gain = lqr(model, q, R)
    periods = margins(PENDULUM, gain, PERIOD).delay_s / PERIOD
    assert periods > 1.0
    assert radius(gain, known, later=math.floor(periods)) < 1.0 < radius(gain, known, later=math.floor(periods) + 1)
