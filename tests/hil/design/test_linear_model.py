# SPDX-License-Identifier: MIT
"""Sampling against closed forms."""

import math

import numpy as np
import pytest

from segway_ecc.hil.design.linear_model import LinearModel, discretise, exponential, poles, with_delay


def test_the_exponential_of_a_rotation_is_the_rotation() -> None:
    for angle in (0.1, 1.0, 30.0):
        turned = exponential(np.array([[0.0, -angle], [angle, 0.0]]))
        expected = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        np.testing.assert_allclose(turned, expected, rtol=0.0, atol=1e-12)


def test_the_exponential_of_zero_is_one() -> None:
    np.testing.assert_array_equal(exponential(np.zeros((2, 2))), np.eye(2))


def test_a_double_integrator_sampled_is_that_of_the_textbooks() -> None:
    model = discretise(LinearModel(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])), 0.1)
    np.testing.assert_allclose(model.a, [[1.0, 0.1], [0.0, 1.0]], rtol=1e-14)
    np.testing.assert_allclose(model.b, [[0.005], [0.1]], rtol=1e-13)


def test_a_lag_sampled_is_that_of_the_textbooks() -> None:
    model = discretise(LinearModel(np.array([[-2.0]]), np.array([[3.0]])), 0.5)
    assert model.a[0, 0] == pytest.approx(math.exp(-1.0), rel=1e-14)
    assert model.b[0, 0] == pytest.approx(1.5 * (1.0 - math.exp(-1.0)), rel=1e-13)


@pytest.mark.parametrize("periods", [0, 1, 2, 5])
def test_a_delayed_input_acts_that_many_periods_later(periods: int) -> None:
    model = with_delay(LinearModel(np.array([[0.5]]), np.array([[1.0]])), periods)
    x = np.zeros((1 + periods, 1))
    outputs = []
    for k in range(10):
        outputs.append(float(x[0, 0]))
        x = model.a @ x + model.b * (1.0 if k == 0 else 0.0)
    expected = [0.0] * (periods + 1) + [0.5**i for i in range(9 - periods)]
    assert outputs == expected


def test_poles_come_with_the_fastest_growing_first() -> None:
    assert poles(np.diag([-3.0, 2.0, 0.0])) == [2.0, 0.0, -3.0]
