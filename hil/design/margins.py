# SPDX-License-Identifier: MIT
"""How far a sampled loop of one input is from instability, from its frequency response.

The loop is broken at the input of the robot, where gain and delay are uncertain: the controller knows the inputs that
it sent and that are under way, and goes on knowing them. With u = -K x - k1 u[-1] - k2 u[-2] ... acting d periods late,
L(z) = z^-d K (zI - A)^-1 B / (1 + k1 z^-1 + k2 z^-2 ...), on z = exp(jwT) up to the Nyquist frequency.
Source: Astrom, Murray, "Feedback Systems" (2nd ed.), 10.3, whose margins these are. A loop around an unstable model
also has a margin below: the gain may not fall too far.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from segway_ecc.hil.design.linear_model import LinearModel, Matrix

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
