# SPDX-License-Identifier: MIT
"""Linear models in state space, from continuous to sampled to sampled with a delay of whole periods.

Sources: Franklin, Powell, Workman, "Digital Control of Dynamic Systems" (3rd ed.), 4.3.3 for the zero-order hold and
8.6 for delays as states; Higham, "The Scaling and Squaring Method for the Matrix Exponential Revisited" (2005).
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

_TAYLOR_TERMS: Final = 18
"""Enough for full precision once the matrix is scaled to a norm of one half or less."""


class LinearModel(NamedTuple):
    """Dx = A x + B u, where D is the time derivative of a continuous model, or the next sample of a sampled one."""

    a: Matrix
    b: Matrix


def exponential(matrix: Matrix) -> Matrix:
    """The matrix exponential, by scaling and squaring."""
    norm = float(np.linalg.norm(matrix, 1))
    squarings = max(0, math.ceil(math.log2(norm)) + 1) if norm > 0.0 else 0
    scaled = matrix / 2.0**squarings
    term = result = np.eye(len(matrix))
    for order in range(1, _TAYLOR_TERMS + 1):
        term = term @ scaled / order
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result


def discretise(model: LinearModel, period_s: float) -> LinearModel:
    """Sample a continuous model whose input is held over each period, s."""
    states, inputs = model.b.shape
    block = np.zeros((states + inputs, states + inputs))
    block[:states, :states] = model.a
    block[:states, states:] = model.b
    sampled = exponential(block * period_s)
    return LinearModel(sampled[:states, :states], sampled[:states, states:])


def with_delay(model: LinearModel, periods: int) -> LinearModel:
    """A sampled model of one input that acts some whole periods late; the inputs under way are states, newest first."""
    states = len(model.a)
    size = states + periods
    a, b = np.zeros((size, size)), np.zeros((size, 1))
    a[:states, :states] = model.a
    if periods == 0:
        return LinearModel(a, model.b.copy())
    a[:states, -1:] = model.b
    for place in range(states + 1, size):
        a[place, place - 1] = 1.0
    b[states, 0] = 1.0
    return LinearModel(a, b)


def poles(a: Matrix) -> list[complex]:
    """Eigenvalues, the slowest of a continuous model (largest real part, then imaginary part) first."""
    return sorted((complex(pole) for pole in np.linalg.eigvals(a)), key=lambda p: (-p.real, -p.imag))
