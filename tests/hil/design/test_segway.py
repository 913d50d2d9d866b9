# SPDX-License-Identifier: MIT
"""The design against the plant's own equations of motion, which are derived and tested on their own."""

import numpy as np
import pytest

from segway_ecc.hil.design.segway import balance_model, design, yaw_model
from segway_ecc.hil.plants.segway_body import SegwayBody
from segway_ecc.node.models.segway_parameters import PUBLISHED

STEP = 1e-5


def test_the_balance_model_is_the_plant_about_upright() -> None:
    a, b = balance_model(PUBLISHED)
    body = SegwayBody(PUBLISHED)
    # Differences, so that friction, the same at rest in both, drops out.
    push = np.subtract(
        body.accelerations(1.0, 0.0, 0.0, 0.0, 0.005, 0.005), body.accelerations(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
    lean = np.subtract(
        body.accelerations(1.0, 0.0, 0.0, 0.001, 0.0, 0.0), body.accelerations(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
    assert b[1, 0] == pytest.approx(push[0] / 0.01, rel=1e-6)
    assert b[3, 0] == pytest.approx(push[1] / 0.01, rel=1e-6)
    assert a[1, 2] == pytest.approx(lean[0] / 0.001, rel=1e-4)
    assert a[3, 2] == pytest.approx(lean[1] / 0.001, rel=1e-4)
    assert (a[0, 1], a[2, 3]) == (1.0, 1.0)
    assert np.count_nonzero(a) == 4


def test_the_yaw_model_is_the_plant_about_upright() -> None:
    _, b = yaw_model(PUBLISHED)
    body = SegwayBody(PUBLISHED)
    turned = body.accelerations(1.0, 0.0, 0.0, 0.0, -0.005, 0.005)[2] - body.accelerations(1.0, 0, 0, 0, 0, 0)[2]
    assert b[1, 0] == pytest.approx(turned / 0.01, rel=1e-6)


def test_the_lean_and_torque_of_an_acceleration_hold_the_pitch() -> None:
    gains = design(PUBLISHED, 0.005, 2).gains
    a, b = balance_model(PUBLISHED)
    x = np.array([[0.0], [0.0], [gains["PitchPerAcceleration"]], [0.0]])
    rates = a @ x + b * gains["TorquePerAcceleration"]
    assert rates[1, 0] == pytest.approx(1.0, rel=1e-9)
    assert rates[3, 0] == pytest.approx(0.0, abs=1e-9)


def test_the_body_shows_how_the_axle_moves_by_the_swing_length_and_the_torque() -> None:
    gains, g = design(PUBLISHED, 0.005, 2).gains, PUBLISHED.gravity
    a, b = balance_model(PUBLISHED)
    per_moment = (g * gains["PitchPerAcceleration"] - 1.0) / gains["TorquePerAcceleration"]
    assert b[1, 0] + gains["SwingLength"] * b[3, 0] == pytest.approx(-per_moment, rel=1e-9)
    assert a[1, 2] + gains["SwingLength"] * a[3, 2] == pytest.approx(g, rel=1e-9)


def test_the_torque_of_a_yaw_acceleration_gives_it() -> None:
    gains = design(PUBLISHED, 0.005, 2).gains
    assert yaw_model(PUBLISHED).b[1, 0] * gains["TorquePerYawAcceleration"] == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_the_design_is_stable_with_room_to_spare(delay: int) -> None:
    found = design(PUBLISHED, 0.005, delay)
    assert found.balance.open_poles[0].real > 0.0
    for loop in (found.balance, found.yaw):
        assert max(abs(pole) for pole in loop.closed_poles) < 1.0
        assert loop.margins.gain_up > 2.0
        assert loop.margins.gain_down < 0.5
        assert loop.margins.phase_rad > np.radians(35.0)
        assert loop.margins.delay_s > 0.020
    assert [found.gains[name] != 0.0 for name in ("SentGain", "SentBeforeGain")] == [delay > 0, delay > 1]


def test_it_pushes_to_where_the_body_leans() -> None:
    gains = design(PUBLISHED, 0.005, 2).gains
    # u = -k3 pitch: ahead under a body that leans ahead; and the signs of a non-minimum-phase plant for the rest.
    assert all(gains[name] < 0.0 for name in ("TravelGain", "VelocityGain", "PitchGain", "PitchRateGain"))
    assert gains["IntegralGain"] < 0.0
