# SPDX-License-Identifier: MIT
"""The linear-quadratic regulator for sampled models.

Source: Anderson, Moore, "Optimal Filtering" (1979), 6.7, for the doubling iteration of the Riccati equation; Franklin,
Powell, Workman, "Digital Control of Dynamic Systems" (3rd ed.), 9.3, for the gain.
"""

from typing import Final

import numpy as np

from segway_ecc.hil.design.linear_model import LinearModel, Matrix
from segway_ecc.node.errors import ConfigurationError

_DOUBLINGS: Final = 64
_TOLERANCE: Final = 1e-12
_NO_GAINS: Final = "no gains were found: the model cannot be stabilised with these weights"


def riccati(model: LinearModel, q: Matrix, r: Matrix) -> Matrix:
    """The stabilising solution P of P = A'PA - A'PB (R + B'PB)^-1 B'PA + Q.

    Args:
        model: A sampled model that can be stabilised.
        q: Weights of the states, positive semidefinite, through which every unstable state can be seen.
        r: Weights of the inputs, positive definite.

    Raises:
        ConfigurationError: There is no solution: the model cannot be stabilised, or the weights do not see it.
    """
    a, p = model.a, q
    g: Matrix = np.asarray(model.b @ np.linalg.solve(r, model.b.T), dtype=np.float64)
    # What diverges does so in a few passes, and is found out below.
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_DOUBLINGS):
            # One pass covers twice as many periods as all before it.
            w: Matrix = np.asarray(np.linalg.inv(np.eye(len(a)) + g @ p), dtype=np.float64)
            step = a.T @ p @ w @ a
            a, g, p = a @ w @ a, g + a @ w @ g @ a.T, p + step
            if not np.isfinite(p).all():
                break
            if np.linalg.norm(step) <= _TOLERANCE * np.linalg.norm(p):
                return 0.5 * (p + p.T)
    raise ConfigurationError(_NO_GAINS)


def lqr(model: LinearModel, q: Matrix, r: Matrix) -> Matrix:
    """The gain K of u = -K x that minimises the sum of x'Qx + u'Ru.

    Raises:
        ConfigurationError: See `riccati`.
    """
    p = riccati(model, q, r)
    b = model.b.T @ p
    gain: Matrix = np.asarray(np.linalg.solve(r + b @ model.b, b @ model.a), dtype=np.float64)
    # A mode out of reach may look settled to the iteration, by rounding; the poles decide.
    if np.abs(np.linalg.eigvals(model.a - model.b @ gain)).max() >= 1.0:
        raise ConfigurationError(_NO_GAINS)
    return gain
