# SPDX-License-Identifier: MIT
"""`segway-ecc prove floor`: trials, table and exit code."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.floor.run import Ending, FloorResult, FloorRun
from segway_ecc.hil.verbs import prove_floor

pytestmark = pytest.mark.mujoco
Run = Callable[..., Any]
ICE = ("prove", "floor", "--only", "ice of 0.2, 0.6", "--jobs", "1")


def pretend(monkeypatch: pytest.MonkeyPatch, ending: Ending, reason: str) -> None:
    def made(runs: Sequence[FloorRun], _jobs: int, on_progress: Callable[[int, int], None]) -> list[FloorResult]:
        on_progress(len(runs), len(runs))
        return [
            FloorResult(
                robot=run.robot,
                trial=run.trial.name,
                kind=run.trial.kind,
                seed=run.seed,
                ending=ending,
                reason=reason,
                way_m=0.5,
                ended_s=None,
            )
            for run in runs
        ]

    monkeypatch.setattr(prove_floor, "run_floor_trials", made)


def test_one_trial_is_made_and_written(segway_ecc: Run, tmp_path: Path) -> None:
    outcome = segway_ecc(*ICE, "--seeds", "1", "--out", str(tmp_path))
    assert outcome.code == 0
    assert outcome.out.startswith("plant segway-contact-plant: wheels slip; ")
    document = json.loads((tmp_path / "floor.json").read_bytes())
    assert [(run["trial"], run["ending"]) for run in document["runs"]] == [("ice of 0.2, 0.6 m/s", "stands")]


def test_what_is_broken_ends_it_with_1_and_is_named(segway_ecc: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, Ending.BROKEN, "sends torque in FAULT, 3 times")
    outcome = segway_ecc(*ICE, "--seeds", "2")
    assert outcome.code == 1
    named = [line for line in outcome.errors if "BROKEN" in line]
    assert named[1] == "segway-ecc: BROKEN: ice of 0.2, 0.6 m/s, seed 2: sends torque in FAULT, 3 times"


def test_what_ends_safe_does_not(segway_ecc: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pretend(monkeypatch, Ending.SAFE, "too fast")
    outcome = segway_ecc(*ICE, "--out", str(tmp_path), "--listed")
    assert outcome.code == 0
    again = segway_ecc(*ICE, "--before", str(tmp_path / "floor.json"), "--json")
    assert json.loads(again.out)["trials"][0]["before_percent"] == 0.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--only", "nonsense"), "no trial has 'nonsense' in its name or kind; the kinds are floor, slope, "),
        (("--seeds", "0"), "--seeds must be at least 1, not 0"),
        (("cart-can",), "robot 'cart-can' has no plant with friction"),
        (("--before", "nowhere.json"), "cannot read nowhere.json"),
        (("--before", __file__), "is no floor.json"),
    ],
)
def test_what_cannot_be_tried_is_refused_in_one_line(segway_ecc: Run, words: tuple[str, ...], message: str) -> None:
    outcome = segway_ecc("prove", "floor", *words)
    assert outcome.code != 0
    assert message in outcome.errors[-1]
