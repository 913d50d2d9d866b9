# SPDX-License-Identifier: MIT
"""The pan-tilt unit against what mechanics says of it in other words."""

import math

import pytest

from segway_ecc.hil.plants.pan_tilt import PanTiltPlant

FREE = {"PanFriction": 0.0, "TiltFriction": 0.0}


def test_energy_is_what_the_motors_give_less_what_friction_takes() -> None:
    plant = PanTiltPlant()
    plant.initialize([0.0, 0.0])
    plant.write("PanRate", 2.0)
    plant.write("Tilt", 0.7)
    plant.write("TiltRate", -1.5)
    _, before, _, rate, energy = plant.output()
    work, step = 0.0, plant.step_size
    for at in range(3000):
        torques = (0.05 * math.sin(0.01 * at), 0.02)
        _, pan_rate, _, tilt_rate, energy_now = plant.step(torques)
        power = [
            0.5 * (old + new) * torque - 0.5 * friction * (old**2 + new**2)
            for old, new, torque, friction in (
                (before, pan_rate, torques[0], 0.05),
                (rate, tilt_rate, torques[1], 0.03),
            )
        ]
        work += step * sum(power)
        before, rate = pan_rate, tilt_rate
    assert energy_now - energy == pytest.approx(work, abs=1e-6)
    assert abs(work) > 0.01


def test_angular_momentum_about_the_vertical_stays_without_torque() -> None:
    plant = PanTiltPlant(FREE)
    plant.initialize([0.0, 0.0])
    plant.write("PanRate", 3.0)
    plant.write("TiltRate", 2.0)

    def momentum() -> float:
        _, pan_rate, tilt, _ = plant.s
        return (0.02 + 0.012 * math.cos(tilt) ** 2 + 0.004 * math.sin(tilt) ** 2) * pan_rate

    first, rates = momentum(), set()
    for _ in range(2000):
        rates.add(round(plant.step([0.0, 0.0])[1], 2))
        assert momentum() == pytest.approx(first, rel=1e-9)
    assert len(rates) > 10, "it turned faster and slower meanwhile"


def test_an_axis_alone_comes_to_its_speed_as_a_first_order_lag() -> None:
    plant = PanTiltPlant()
    plant.initialize([0.0, 0.0])
    for _ in range(500):
        _, _, tilt, rate, _ = plant.step([0.0, 0.06])
    lag_s = 0.015 / 0.03
    assert rate == pytest.approx(2.0 * (1.0 - math.exp(-0.5 / lag_s)), rel=1e-9)
    assert tilt == pytest.approx(2.0 * (0.5 - lag_s * (1.0 - math.exp(-0.5 / lag_s))), rel=1e-9)
