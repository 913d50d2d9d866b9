# SPDX-License-Identifier: MIT
"""Linear models in state space: sampled, with a delay of whole periods; their quadratic regulator and their margins.

The loop is broken at the input of the robot, where gain and delay are uncertain: the controller knows the inputs that
it sent and that are under way, and goes on knowing them. With u = -K x - k1 u[-1] - k2 u[-2] ... acting d periods late,
L(z) = z^-d K (zI - A)^-1 B / (1 + k1 z^-1 + k2 z^-2 ...), on z = exp(jwT) up to the Nyquist frequency. A loop around
an unstable model also has a margin below: the gain may not fall too far.

Sources: Franklin, Powell, Workman, "Digital Control of Dynamic Systems" (3rd ed.), 4.3.3 for the zero-order hold, 8.6
for delays as states and 9.3 for the regulator's gain; Higham, "The Scaling and Squaring Method for the Matrix
Exponential Revisited" (2005); Anderson, Moore, "Optimal Filtering" (1979), 6.7, for the doubling iteration of the
Riccati equation; Astrom, Murray, "Feedback Systems" (2nd ed.), 10.3, for the margins.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from segway_ecc.node.errors import ConfigurationError

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
    block = np.vstack([np.hstack([model.a, model.b]), np.zeros((inputs, states + inputs))])
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
    a[states + 1 :, states:-1] = np.eye(periods - 1)
    b[states, 0] = 1.0
    return LinearModel(a, b)


def poles(a: Matrix) -> list[complex]:
    """Eigenvalues, the slowest of a continuous model (largest real part, then imaginary part) first."""
    return sorted((complex(pole) for pole in np.linalg.eigvals(a)), key=lambda p: (-p.real, -p.imag))


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


_POINTS: Final = 20_000
_SLOWEST: Final = 1e-6
"""Lowest frequency looked at, as a part of the Nyquist frequency."""

Response = NDArray[np.complex128]


class Margins(NamedTuple):
    """Margins of a stable closed loop.

    Attributes:
        gain_up: Factor by which the loop's gain may grow; infinite where nothing limits it.
        gain_down: Factor to which it may fall; zero where nothing limits it.
        phase_rad: Smallest phase that may be lost, rad; infinite where the gain crosses one nowhere.
        delay_s: Smallest delay that may be added, s.
        crossover_rad_s: Highest frequency at which the loop's gain is one, rad/s.
    """

    gain_up: float
    gain_down: float
    phase_rad: float
    delay_s: float
    crossover_rad_s: float


def loop_response(model: LinearModel, gain: Matrix, z: Response) -> Response:
    """L(z) at some points of the complex plane.

    Args:
        model: The sampled model without its delay.
        gain: Of its states, then of each input under way, newest first: as many as there are periods of delay.
        z: The points.
    """
    states = len(model.a)
    under_way = gain[0, states:]
    solved = np.linalg.solve(z[:, None, None] * np.eye(states) - model.a, model.b.astype(complex)[None])
    ahead = solved[:, :, 0] @ gain[0, :states]
    back = 1.0 + sum(k * z ** -(i + 1.0) for i, k in enumerate(under_way))
    response: Response = ahead * z ** -float(len(under_way)) / back
    return response


def margins(model: LinearModel, gain: Matrix, period_s: float) -> Margins:
    """The margins of a loop that is stable; see `loop_response` for what is given."""
    nyquist = math.pi / period_s
    w = np.geomspace(_SLOWEST * nyquist, nyquist, _POINTS)
    response = loop_response(model, gain, np.exp(1j * w * period_s))
    # How far the response may turn clockwise before it points to -1, rad from 0 to 2 pi.
    crossed = _crossings(w, np.abs(response) - 1.0, response)
    lost = [(math.atan2(-value.imag, -value.real) % (2.0 * math.pi), at) for at, value in crossed]
    real = [value.real for _, value in _crossings(w, response.imag, response)] + [
        float(response[i].real) for i in (0, -1)
    ]
    factors = [-1.0 / value for value in real if value < 0.0]
    return Margins(
        gain_up=min((factor for factor in factors if factor > 1.0), default=math.inf),
        gain_down=max((factor for factor in factors if factor < 1.0), default=0.0),
        phase_rad=min((min(phase, 2.0 * math.pi - phase) for phase, _ in lost), default=math.inf),
        delay_s=min((phase / at for phase, at in lost), default=math.inf),
        crossover_rad_s=max((at for _, at in lost), default=0.0),
    )


def _crossings(w: NDArray[np.float64], sign: NDArray[np.float64], response: Response) -> list[tuple[float, complex]]:
    """Where `sign` changes: the frequency and the response there, by straight lines between the points."""
    found = []
    for i in np.nonzero(sign[:-1] * sign[1:] < 0.0)[0]:
        share = float(sign[i] / (sign[i] - sign[i + 1]))
        at = float(w[i] + share * (w[i + 1] - w[i]))
        found.append((at, complex(response[i] + share * (response[i + 1] - response[i]))))
    return found
