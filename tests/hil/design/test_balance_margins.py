# SPDX-License-Identifier: MIT
"""What is tolerated and followed: every requirement is in the table, and a step is judged as it should be."""

import math

import pytest

from segway_ecc.hil.design.balance_margins import STEPS, Tracking, disturbances, recovers, track, tracked
from segway_ecc.node.config import load_robot
from segway_ecc.node.models.segway_parameters import PUBLISHED

KINDS = {kind.name: kind for kind in disturbances(PUBLISHED)}
TICKS = [i * 0.01 - 3.0 for i in range(1201)]


def test_every_requirement_is_in_the_table() -> None:
    required = {name: kind.required for name, kind in KINDS.items() if kind.required is not None}
    # 30 % of the body's mass, 5 degrees, 20 ms.
    assert required["payload at the centre, more"] == pytest.approx(0.3 * PUBLISHED.body_mass)
    assert required["payload at the centre, less"] == pytest.approx(-0.3 * PUBLISHED.body_mass)
    assert required["slope, up"] == pytest.approx(math.pi / 36.0)
    assert required["slope, down"] == pytest.approx(-math.pi / 36.0)
    assert required["delay added"] == 0.02
    assert (required["push ahead, 1 s"], required["push back, 1 s"]) == (10.0, -10.0)
    assert {step.setpoint for step in STEPS} == {(1.0, 0.0), (0.0, 1.0), (1.0, 1.0)}


@pytest.mark.parametrize("name", ["push ahead, 1 s", "push back, 1 s"])
@pytest.mark.parametrize(("share", "expected"), [(0.1, True), (0.9, False)])
def test_a_long_push_is_tolerated_or_not(name: str, share: float, expected: bool) -> None:  # noqa: FBT001 - a parameter of the test
    kind = KINDS[name]
    assert recovers(load_robot("segway"), kind, share * kind.most, 1) is expected


@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.name)
def test_the_packaged_robot_follows(step: object) -> None:
    found = track(load_robot("segway"), step, (1,))  # type: ignore[arg-type]  # one of STEPS
    assert found.is_enough
    assert 0.5 < found.settled_s < 5.0
    assert found.steady_error < found.largest_error < 0.15


def test_a_step_that_is_followed_late_settles_late() -> None:
    errors = [(time, -1.0 if time < 1.25 else 0.05 if time < 4.0 else -0.03) for time in TICKS]
    steady, largest, settled_s = tracked(errors)
    assert (steady, largest) == pytest.approx((0.03, 0.03))
    assert settled_s == pytest.approx(1.24)


def test_what_swings_has_no_steady_error_and_never_settles() -> None:
    errors = [(time, 0.2 * math.cos(math.pi * i)) for i, time in enumerate(TICKS)]
    steady, largest, settled_s = tracked(errors)
    assert steady < 0.01
    assert largest == pytest.approx(0.2)
    assert settled_s == math.inf
    assert not Tracking("swings", "m/s", steady, largest, settled_s, 0.05).is_enough


def test_what_ends_early_was_not_followed() -> None:
    assert tracked([(time, 0.0) for time in TICKS[:600]]) == (math.inf, math.inf, math.inf)


@pytest.mark.parametrize(("error", "expected"), [(0.05, True), (0.051, False)])
def test_too_large_a_steady_error_is_not_enough(error: float, expected: bool) -> None:  # noqa: FBT001 - a parameter of the test
    assert Tracking("a step", "m/s", error, error, 1.0, 0.05).is_enough is expected
