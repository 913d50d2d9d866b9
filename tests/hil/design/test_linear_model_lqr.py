# SPDX-License-Identifier: MIT
"""The regulator against a closed form, and against the equation that it solves."""

import math

import numpy as np
import pytest

from segway_ecc.hil.design.linear_model import LinearModel, discretise, lqr, riccati
from segway_ecc.node.errors import ConfigurationError

PENDULUM = discretise(LinearModel(np.array([[0.0, 1.0], [9.0, 0.0]]), np.array([[0.0], [1.0]])), 0.01)


def test_of_a_scalar_the_solution_is_the_root_of_its_quadratic() -> None:
    a, b, q, r = 1.2, 0.5, 2.0, 3.0
    # b^2 p^2 + (r - a^2 r - b^2 q) p - q r = 0
    linear = r - a * a * r - b * b * q
    p = (-linear + math.sqrt(linear * linear + 4.0 * b * b * q * r)) / (2.0 * b * b)
    model = LinearModel(np.array([[a]]), np.array([[b]]))
    assert riccati(model, np.array([[q]]), np.array([[r]]))[0, 0] == pytest.approx(p, rel=1e-10)
    assert lqr(model, np.array([[q]]), np.array([[r]]))[0, 0] == pytest.approx(b * p * a / (r + b * b * p), rel=1e-10)


def test_the_solution_solves_the_equation_and_the_loop_is_stable() -> None:
    q, r = np.diag([4.0, 0.25]), np.array([[2.0]])
    p = riccati(PENDULUM, q, r)
    a, b = PENDULUM
    k = lqr(PENDULUM, q, r)
    np.testing.assert_allclose(a.T @ p @ (a - b @ k) + q, p, rtol=1e-7)
    np.testing.assert_array_equal(p, p.T)
    assert max(abs(np.linalg.eigvals(a))) > 1.0
    assert max(abs(np.linalg.eigvals(a - b @ k))) < 1.0


def test_no_neighbouring_gain_costs_less() -> None:
    q, r = np.diag([4.0, 0.25]), np.array([[2.0]])
    best = lqr(PENDULUM, q, r)

    def cost(k: np.ndarray) -> float:
        total, x = 0.0, np.array([[1.0], [0.5]])
        for _ in range(5000):
            u = -k @ x
            total += float((x.T @ q @ x + u.T @ r @ u)[0, 0])
            x = PENDULUM.a @ x + PENDULUM.b @ u
        return total

    around = [best * np.array([[f, g]]) for f, g in ((0.95, 1.0), (1.05, 1.0), (1.0, 0.95), (1.0, 1.05))]
    assert all(cost(k) > cost(best) for k in around)


def test_what_cannot_be_stabilised_is_refused() -> None:
    model = LinearModel(np.diag([2.0, 0.5]), np.array([[0.0], [1.0]]))
    with pytest.raises(ConfigurationError, match=r"^no gains were found: "):
        lqr(model, np.eye(2), np.eye(1))
