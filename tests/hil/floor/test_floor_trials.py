# SPDX-License-Identifier: MIT
"""Trials on a floor: that there are enough of each kind, how one is judged, and what is made of many."""

from types import SimpleNamespace
from typing import Any

import pytest

from segway_ecc.hil.floor.contact import on_floor
from segway_ecc.hil.floor.run import Ending, FloorResult, FloorRun, judge, run_floor_trial
from segway_ecc.hil.floor.trials import FALLS, UP_S, TrialKind, all_trials, listed_trials
from segway_ecc.hil.floor.trials_report import as_document, as_text, before_of, draw, rows_of, totals_of
from segway_ecc.hil.rig.simulation import simulated_plant
from segway_ecc.node.config import load_robot
from segway_ecc.node.models.segway_parameters import PUBLISHED
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture

TRIALS = all_trials(PUBLISHED)


def test_there_are_trials_of_each_kind_and_every_name_is_one_trials() -> None:
    names = [trial.name for trial in TRIALS]
    assert len(set(names)) == len(names) >= 67, "with three seeds more than 200"
    assert {trial.kind for trial in TRIALS} == set(TrialKind)
    assert set(FALLS) <= {trial.name for trial in listed_trials(PUBLISHED)}


@pytest.mark.mujoco
def test_every_trial_changes_what_the_plant_has() -> None:
    plant = simulated_plant(on_floor(load_robot("segway")))
    names = {variable.name for variable in (*plant.parameters, *plant.states)}
    for trial in TRIALS:
        assert set(trial.plant) <= names, trial.name


def _ran(mode: Mode, posture: Posture | None, lean: float, reason: str, **other: Any) -> Any:
    modes = other.get("modes", [Mode.ARMED, mode])
    return SimpleNamespace(
        modes=modes,
        postures=[None, posture],
        truth=[SimpleNamespace(pitch=lean)],
        commands=other.get("commands", [(1.0, 1.0), (0.0, 0.0)]),
        loop=SimpleNamespace(arming_refusal="imu_still: no", modes=SimpleNamespace(reason=reason)),
    )


@pytest.mark.parametrize(
    ("ran", "ending", "reason"),
    [
        (_ran(Mode.ARMED, Posture.BALANCING, 0.02, "asked to arm"), Ending.STANDS, ""),
        (_ran(Mode.FAULT, Posture.FALLEN, 0.5, "fell"), Ending.SAFE, "fell"),
        (_ran(Mode.DISARMED, None, 0.5, "", modes=[Mode.DISARMED] * 2, commands=[(0.0,)] * 2), Ending.SAFE, "imu_st"),
        (_ran(Mode.FAULT, Posture.FALLEN, 0.5, ""), Ending.BROKEN, "is in FAULT and gives no reason"),
        (_ran(Mode.FAULT, None, 0.5, "fell", commands=[(1.0,), (0.1,)]), Ending.BROKEN, "sends torque in FAULT, 1 tim"),
        (_ran(Mode.ARMED, Posture.BALANCING, 0.5, "x"), Ending.BROKEN, "is in ARMED, is BALANCING, and leans by 0.50"),
        (_ran(Mode.ARMED, Posture.STANDING_UP, 0.5, "x"), Ending.BROKEN, "is in ARMED, is STANDING UP, and leans"),
        (_ran(Mode.HOLD, None, 0.0, "x"), Ending.BROKEN, "is in HOLD, has no posture"),
    ],
)
def test_a_robot_stands_or_ends_safe_or_is_broken(ran: Any, ending: Ending, reason: str) -> None:
    found, why = judge(ran)
    assert found is ending
    assert why.startswith(reason)


@pytest.mark.mujoco
@pytest.mark.parametrize("late_s", [0.3, 0.5, 0.7])
def test_a_robot_that_falls_as_its_trial_ends_is_seen_to_end_safe(late_s: float) -> None:
    trial = next(trial for trial in TRIALS if trial.kind is TrialKind.PUSH)
    result = run_floor_trial(FloorRun("segway", trial._replace(push=300.0, push_s=0.1, duration_s=UP_S + late_s), 1))
    assert result.ending is Ending.SAFE, result.reason


@pytest.mark.mujoco
def test_a_push_beyond_its_limits_ends_safe_with_a_reason() -> None:
    trial = next(trial for trial in TRIALS if trial.kind is TrialKind.PUSH)
    result = run_floor_trial(FloorRun("segway", trial._replace(push=300.0, duration_s=5.0), 1))
    assert result.ending is Ending.SAFE
    assert result.reason
    assert result.ended_s is not None
    assert 3.5 < result.ended_s < 4.5


def _result(trial: str, seed: int, ending: Ending, kind: TrialKind = TrialKind.PUSH, reason: str = "") -> FloorResult:
    return FloorResult(
        robot="r", trial=trial, kind=kind, seed=seed, ending=ending, reason=reason, way_m=0.1, ended_s=None
    )


RESULTS = [
    _result("a", 1, Ending.STANDS),
    _result("a", 2, Ending.SAFE, reason="too fast"),
    _result("b", 1, Ending.BROKEN, TrialKind.FLOOR, "sends torque in FAULT, 1 times"),
]


def test_shares_are_of_the_seeds_of_a_trial_of_a_kind_and_of_all() -> None:
    assert [(row.name, row.percent(Ending.STANDS)) for row in rows_of(RESULTS)] == [("a", 50.0), ("b", 0.0)]
    totals = {row.name: row for row in totals_of(RESULTS)}
    assert {name: row.runs for name, row in totals.items()} == {"push": 2, "floor": 1, "all": 3}
    assert totals["all"].endings[Ending.BROKEN] == 1


def test_an_earlier_run_stands_beside_it() -> None:
    before = before_of(as_document([_result("a", 1, Ending.STANDS)], {}))
    lines = [line.split("  ") for line in as_text(RESULTS, before).splitlines() if line]
    assert [cell.strip() for cell in lines[1] if cell][:5] == ["a", "r", "2", "100", "50"]
    assert [cell.strip() for cell in lines[2] if cell][:6] == ["b", "r", "1", "-", "0", "0"]
    document = as_document(RESULTS, before)
    assert [row["before_percent"] for row in document["trials"]] == [100.0, None]
    totals = {row["trial"]: row["before_percent"] for row in document["totals"]}
    assert totals == {"push": 100.0, "floor": None, "all": None}, "not all of these trials were made before"


def test_the_figure_is_drawn() -> None:
    pytest.importorskip("matplotlib")
    assert draw(RESULTS, "a title")["floor.png"].startswith(b"\x89PNG")
