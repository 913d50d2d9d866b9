# SPDX-License-Identifier: MIT
import math
from collections.abc import Sequence

import pytest

from segway_ecc.node.model.sectioned import ADVANCE, Dynamic, Method

ORDERS = {Method.EULER: 1, Method.RUNGE_KUTTA_2: 2, Method.RUNGE_KUTTA_4: 4}


def quadratic(t: float, s: Sequence[float]) -> Sequence[float]:
    """A right side in which a wrong time, a wrong state or swapped states all show: x' = t + y, y' = x."""
    x, y = s
    return (t + y, x)


def test_every_method_has_the_name_20_sim_gives_it() -> None:
    assert [str(method) for method in ADVANCE] == ["Discrete", "Euler", "RungeKutta2", "RungeKutta4"]
    assert set(ADVANCE) == set(Method)


# Worked by hand from t = 1, (x, y) = (1, 2), h = 0.5, all in binary fractions, so exact:
# Euler: r = (3, 1).
# Midpoint: middle (1.75, 2.25) at t = 1.25, r = (3.5, 1.75).
# Classical: r1 = (3, 1); r2 at 1.25 of (1.75, 2.25) = (3.5, 1.75); r3 at 1.25 of (1.875, 2.4375) = (3.6875, 1.875);
#   r4 at 1.5 of (2.84375, 2.9375) = (4.4375, 2.84375); sums (21.8125, 11.09375) times h / 6.
@pytest.mark.parametrize(
    ("method", "expected"),
    [
        (Method.DISCRETE, (3.0, 1.0)),
        (Method.EULER, (2.5, 2.5)),
        (Method.RUNGE_KUTTA_2, (2.75, 2.875)),
        (Method.RUNGE_KUTTA_4, (1.0 + 21.8125 / 12.0, 2.0 + 11.09375 / 12.0)),
    ],
)
def test_one_step_is_the_one_worked_by_hand(method: Method, expected: tuple[float, float]) -> None:
    assert ADVANCE[method](quadratic, 1.0, (1.0, 2.0), 0.5) == pytest.approx(expected, rel=1e-15)


def test_discrete_takes_the_next_states_as_they_are_whatever_the_step() -> None:
    assert ADVANCE[Method.DISCRETE](lambda t, s: (s[0] + 1.0, t), 7.0, (4.0, 0.0), 123.0) == [5.0, 7.0]


@pytest.mark.parametrize(
    ("dynamic", "exact"),
    [
        # x' = x, x(0) = 1: x(1) = e.
        pytest.param(lambda _t, s: (s[0],), math.e, id="growth"),
        # x' = x + t, x(0) = 1: x(t) = 2 e^t - t - 1.
        pytest.param(lambda t, s: (s[0] + t,), 2.0 * math.e - 2.0, id="driven by time"),
        # x' = x cos t, x(0) = 1: x(t) = e^(sin t).
        pytest.param(lambda t, s: (s[0] * math.cos(t),), math.exp(math.sin(1.0)), id="time and state multiplied"),
    ],
)
@pytest.mark.parametrize("method", ORDERS)
def test_halving_the_step_divides_the_error_by_two_to_the_order(method: Method, dynamic: Dynamic, exact: float) -> None:
    def error(steps: int) -> float:
        h, s = 1.0 / steps, [1.0]
        for k in range(steps):
            s = ADVANCE[method](dynamic, k * h, s, h)
        return abs(s[0] - exact)

    assert math.log2(error(64) / error(128)) == pytest.approx(ORDERS[method], abs=0.05)


@pytest.mark.parametrize("method", ADVANCE)
def test_the_states_given_are_left_as_they_were(method: Method) -> None:
    states = [1.0, 2.0]
    ADVANCE[method](quadratic, 0.0, states, 0.1)
    assert states == [1.0, 2.0]


@pytest.mark.parametrize("method", ORDERS)
def test_a_right_side_of_the_wrong_length_is_refused(method: Method) -> None:
    with pytest.raises(ValueError, match="zip"):
        ADVANCE[method](lambda _t, _s: (1.0,), 0.0, (1.0, 2.0), 0.1)


@pytest.mark.parametrize("method", ADVANCE)
def test_a_model_without_states_stays_without(method: Method) -> None:
    assert ADVANCE[method](lambda _t, _s: (), 0.0, (), 0.1) == []
