# SPDX-License-Identifier: MIT
"""A run is judged by what was expected, and by nothing else."""

import msgspec
import pytest

from segway_ecc.hil.campaign.scenario import Expectation, ScenarioResult, judged

RESULT = ScenarioResult(
    source="can-cut",
    scenario="can-cut",
    robot="cart-can",
    seed=3,
    parameters={"plant.Inertia": 0.003},
    outcome="faults",
    reason="left.velocity is too old: 35 ms",
    detection_s=0.02,
    safe_s=0.045,
    max_tilt_rad=0.3,
    max_distance_m=0.4,
    switches=(),
    simulated_s=2.0,
    digest="00",
)
MET = Expectation(
    outcome="faults", reason="too old", within_s=0.02, safe_within_s=0.045, max_tilt_rad=0.3, max_distance_m=0.4
)


def test_what_is_met_to_the_limit_is_as_expected() -> None:
    assert judged(RESULT, MET).is_as_expected


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"outcome": "holds"}, "outcome faults, not holds"),
        ({"reason": "tilt"}, "reason 'left.velocity is too old: 35 ms' has no 'tilt'"),
        ({"within_s": 0.01}, "detected 0.02 s, more than 0.01 s"),
        ({"safe_within_s": 0.04}, "safe 0.045 s, more than 0.04 s"),
        ({"max_tilt_rad": 0.2}, "tilt 0.3 rad, more than 0.2 rad"),
        ({"max_distance_m": 0.3}, "distance 0.4 m, more than 0.3 m"),
    ],
)
def test_each_limit_that_is_not_met_is_reported(change: dict[str, object], why: str) -> None:
    result = judged(RESULT, msgspec.structs.replace(MET, **change))
    assert result.why_not == (why,)
    assert not result.is_as_expected


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"detection_s": None}, "never detected"),
        ({"safe_s": None}, "never safe"),
        ({"max_tilt_rad": None}, "the plant has no tilt"),
        ({"max_distance_m": float("nan")}, "distance nan m, more than 0.4 m"),
    ],
)
def test_what_never_came_is_not_within_its_limit(change: dict[str, object], why: str) -> None:
    assert judged(msgspec.structs.replace(RESULT, **change), MET).why_not == (why,)


@pytest.mark.parametrize("outcome", ["drives_on", "holds"])
def test_a_robot_that_lies_on_the_ground_is_never_as_expected_where_it_is_driven(outcome: str) -> None:
    lies = msgspec.structs.replace(RESULT, outcome=outcome, has_fallen=True)
    expect = msgspec.structs.replace(MET, outcome=outcome)
    assert judged(lies, expect).why_not == (f"the robot lies on the ground, and {outcome}",)
    assert judged(msgspec.structs.replace(lies, outcome="faults"), MET).is_as_expected


def test_of_several_reasons_one_is_enough() -> None:
    several = msgspec.structs.replace(MET, reason=("fallen", "too old"))
    assert judged(RESULT, several).is_as_expected
    other = msgspec.structs.replace(RESULT, reason="stop was pressed")
    assert judged(other, several).why_not == ("reason 'stop was pressed' has no 'fallen' or 'too old'",)


def test_what_is_not_declared_is_not_looked_at() -> None:
    worst = msgspec.structs.replace(
        RESULT, reason="", detection_s=None, safe_s=None, max_tilt_rad=None, max_distance_m=1e9
    )
    assert judged(worst, Expectation(outcome="faults")).is_as_expected


def test_the_command_runs_it_again() -> None:
    assert RESULT.command == "segway-ecc prove fault can-cut --robot cart-can --seed 3 --set plant.Inertia=0.003"
    spaced = msgspec.structs.replace(RESULT, source="my file.yaml", parameters={})
    assert spaced.command == "segway-ecc prove fault 'my file.yaml' --robot cart-can --seed 3"
