# SPDX-License-Identifier: MIT
"""Fixed-step integration methods, under the names 20-sim gives them.

Sources: the 20-sim reference manual, "Integration Methods"; Hairer, Norsett, Wanner, "Solving Ordinary Differential
Equations I" (2nd ed.), table II.1.2 for the classical Runge-Kutta method and II.1.1 for the midpoint rule.
"""

import enum
from collections.abc import Callable, Sequence

Dynamic = Callable[[float, Sequence[float]], Sequence[float]]
"""The dynamic section: (time in s, states) -> rates per second, or the next states for `Method.DISCRETE`."""

Advance = Callable[[Dynamic, float, Sequence[float], float], list[float]]
"""(dynamic, time in s, states, step in s) -> the states one step later."""


@enum.unique
class Method(enum.StrEnum):
    """The fixed-step methods."""

    DISCRETE = "Discrete"
    EULER = "Euler"
    RUNGE_KUTTA_2 = "RungeKutta2"
    RUNGE_KUTTA_4 = "RungeKutta4"


def _runge_kutta_2(dynamic: Dynamic, t: float, s: Sequence[float], h: float) -> list[float]:
    half = 0.5 * h
    middle = [x + half * r for x, r in zip(s, dynamic(t, s), strict=True)]
    return [x + h * r for x, r in zip(s, dynamic(t + half, middle), strict=True)]


def _runge_kutta_4(dynamic: Dynamic, t: float, s: Sequence[float], h: float) -> list[float]:
    half = 0.5 * h
    r1 = dynamic(t, s)
    r2 = dynamic(t + half, [x + half * r for x, r in zip(s, r1, strict=True)])
    r3 = dynamic(t + half, [x + half * r for x, r in zip(s, r2, strict=True)])
    r4 = dynamic(t + h, [x + h * r for x, r in zip(s, r3, strict=True)])
    sixth = h / 6.0
    return [x + sixth * (a + 2.0 * b + 2.0 * c + d) for x, a, b, c, d in zip(s, r1, r2, r3, r4, strict=True)]


ADVANCE: dict[Method, Advance] = {
    Method.DISCRETE: lambda dynamic, t, s, _h: list(dynamic(t, s)),
    Method.EULER: lambda dynamic, t, s, h: [x + h * r for x, r in zip(s, dynamic(t, s), strict=True)],
    Method.RUNGE_KUTTA_2: _runge_kutta_2,
    Method.RUNGE_KUTTA_4: _runge_kutta_4,
}
