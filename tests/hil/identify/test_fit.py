# SPDX-License-Identifier: MIT
"""The fit alone, on windows that its own equations made: it finds what was put in, and its intervals hold."""

import dataclasses

import numpy as np
import pytest

from segway_ecc.hil.design.linear_model import Matrix
from segway_ecc.hil.identify.advice import ranked
from segway_ecc.hil.identify.fit import Fit, Fitter
from segway_ecc.hil.identify.identify import identify
from segway_ecc.hil.identify.prediction import Predictor
from segway_ecc.hil.identify.quantities import Quantity, prior, quantities
from segway_ecc.hil.identify.windows import HISTORY, SAMPLES, Run, Windows, windows_of
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.models.segway_parameters import PUBLISHED, SegwayParameters

PERIOD_S = 0.005
NOISE = np.array([1e-4, 1e-4, 2e-3, 2e-3, 2e-3, 0.02, 0.02, 0.02])
OFF = {"BodyMass": 1.2, "BodyPitchInertia": 0.8, "WheelRadius": 0.85, "Track": 1.15, "CoulombFriction": 1.3}


def made(
    sought: tuple[Quantity, ...], *, seed: int, turning: bool = True, p: SegwayParameters = PUBLISHED
) -> tuple[Windows, Matrix]:
    """Windows of a torque-driven robot that is off by `OFF`, otherwise `p`, and its coordinates."""
    rng = np.random.default_rng(seed)
    true, _ = prior(sought)
    true = true + np.array([np.log(OFF.get(q.name, 1.0)) if q.is_size else 0.0 for q in sought])
    count = 8
    straight = np.repeat(rng.normal(0.0, 0.3, (count, (HISTORY + SAMPLES) // 8, 1)), 8, axis=1)
    turn = np.repeat(rng.normal(0.0, 0.2, (count, (HISTORY + SAMPLES) // 8, 1)), 8, axis=1) * turning
    sent = np.concatenate([straight - turn, straight + turn, np.ones_like(turn)], axis=2)
    start = rng.normal(0.0, 1.0, (count, 6)) * [0.3, 0.3, 0.5 * turning, 0.05, 1.0, 1.0] + [0.6, 0, 0, 0, 0, 0]
    empty = Windows(PERIOD_S, sent, np.zeros((count, SAMPLES, 8)), np.ones((count, SAMPLES)), start, np.zeros((0, 3)))
    shown = Predictor(p, sought, voltage=False).predict(true[None], empty, start[None])[0]
    measured = shown + rng.normal(0.0, 1.0, shown.shape) * NOISE
    return empty._replace(measured=measured, start=start + rng.normal(0.0, 0.01, start.shape)), true


def fitted(seed: int, *, turning: bool = True) -> tuple[Fit, Matrix]:
    sought = quantities(PUBLISHED, voltage=False)
    windows, true = made(sought, seed=seed, turning=turning)
    return Fitter(Predictor(PUBLISHED, sought, voltage=False), sought, windows).fit(), true


def test_what_was_put_in_is_found_within_three_deviations() -> None:
    fit, true = fitted(1)
    deviations = np.sqrt(np.diag(fit.covariance))
    assert fit.converged
    assert np.abs((fit.coordinates - true) / deviations).max() < 3.0
    for q, found, right in zip(fit.quantities, fit.coordinates, true, strict=True):
        if q.name in OFF:
            assert found == pytest.approx(right, abs=0.05), q.name


def test_roll_inertia_that_is_off_does_not_pull_the_other_quantities_out_of_their_intervals() -> None:
    sought = quantities(PUBLISHED, voltage=False)
    off = dataclasses.replace(PUBLISHED, body_roll_inertia=0.7 * PUBLISHED.body_roll_inertia)
    windows, true = made(quantities(off, voltage=False), seed=3, p=off)

    fit = Fitter(Predictor(PUBLISHED, sought, voltage=False), sought, windows).fit()

    beyond = np.abs((fit.coordinates - true) / np.sqrt(np.diag(fit.covariance)))
    assert {q.name: z for q, z in zip(sought, beyond, strict=True) if q.is_parameter and z > 3.0} == {}


def test_what_never_turned_leaves_the_track_and_the_yaw_inertia_as_they_were() -> None:
    fit, _true = fitted(2, turning=False)
    names = [q.name for q in fit.quantities]
    spread = [q.deviation for q in fit.quantities]
    for name in ("Track", "BodyYawInertia"):
        place = names.index(name)
        assert np.sqrt(fit.covariance[place, place]) > 0.7 * spread[place]


def test_the_advice_that_shrinks_the_uncertain_most_comes_first_and_what_does_not_help_is_left_out() -> None:
    covariance = np.diag([0.3, 0.3, 0.01]) ** 2
    gains = [
        ("tells the first", np.diag([1e2, 0.0, 0.0])),
        ("tells what is known", np.diag([0.0, 0.0, 1e6])),
        ("tells both", np.diag([1e2, 1e2, 0.0])),
    ]
    found = ranked(covariance, [0, 1], gains, ["a", "b", "c"])
    assert [advice.what for advice in found] == ["tells both", "tells the first"]
    assert set(found[0].expected) == {"a", "b"}
    assert found[1].expected["a"] == pytest.approx(1.96 * (0.3**-2 + 1e2) ** -0.5)


def test_a_robot_that_lies_all_the_time_is_refused_with_what_to_do() -> None:
    lying = Run(
        PERIOD_S, np.zeros((400, 3)), np.zeros((400, 8)), np.full(400, 0.5), np.zeros((400, 2)), np.ones(400, bool)
    )
    with pytest.raises(ConfigurationError, match="record it while it stands up"):
        identify([lying], PUBLISHED, voltage=True)


def test_runs_of_different_periods_are_refused() -> None:
    run = Run(PERIOD_S, np.zeros((9, 3)), np.zeros((9, 8)), np.zeros(9), np.zeros((9, 2)), np.ones(9, bool))
    with pytest.raises(ConfigurationError, match="different periods"):
        windows_of([run, run._replace(period_s=0.01)], radius=0.05, stop_angle=0.5)


@pytest.mark.parametrize(
    ("measured", "message"),
    [
        ({"Colour": 1.0}, "nothing of that name"),
        ({"BodyMass": -1.0}, "is to be from 0.1"),
        ({"MotorConstant": 0.02}, "nothing"),
    ],
)
def test_a_measured_value_that_cannot_be_is_refused(measured: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        quantities(PUBLISHED, voltage=False, measured=measured)


def test_a_measured_value_is_held() -> None:
    (mass,) = (q for q in quantities(PUBLISHED, voltage=True, measured={"BodyMass": 7.0}) if q.name == "BodyMass")
    assert (mass.known, mass.deviation) == (7.0, 0.01)
