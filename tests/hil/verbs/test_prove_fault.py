# SPDX-License-Identifier: MIT
"""`segway-ecc prove fault`: one scenario, its result and its exit code."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.campaign.scenario import load_all

Run = Callable[..., Any]

SCENARIO = """
name: mine
robot: [cart-can, cart-vesc]
segments: [{linear: 1.0, duration: 1.0}]
seeds: [3]
faults: [{target: can, type: off, at_s: 0.5}]
expect: {outcome: faults, reason: too old}
"""


@pytest.fixture
def scenario(tmp_path: Path) -> str:
    path = tmp_path / "mine.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return str(path)


def test_what_comes_as_expected_ends_with_0(segway_ecc: Run, scenario: str) -> None:
    outcome = segway_ecc("prove", "fault", scenario)
    assert outcome.code == 0
    assert outcome.errors == []
    lines = dict(line.split("  ", 1) for line in outcome.out.splitlines())
    assert lines["outcome"].strip() == "faults"
    assert lines["verdict"].strip() == "as expected"
    assert lines["again"].strip() == f"segway-ecc prove fault {scenario} --robot cart-can --seed 3"


def test_what_does_not_ends_with_1(segway_ecc: Run, scenario: str) -> None:
    Path(scenario).write_text(SCENARIO.replace("outcome: faults", "outcome: holds"), encoding="utf-8")
    outcome = segway_ecc("prove", "fault", scenario)
    assert outcome.code == 1
    assert "outcome faults, not holds" in outcome.out


def test_seed_robot_and_parameters_can_be_given(segway_ecc: Run, scenario: str, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    words = (
        "prove",
        "fault",
        scenario,
        "--robot",
        "cart-vesc",
        "--seed",
        "0",
        "--set",
        "plant.Inertia=0.003",
        "--json",
    )
    outcome = segway_ecc(*words, "--log", str(log))
    result = json.loads(outcome.out)
    assert (result["robot"], result["seed"], result["parameters"]) == ("cart-vesc", 0, {"plant.Inertia": 0.003})
    assert result["as_expected"] is True
    assert log.exists()
    assert json.loads(segway_ecc(*words).out)["digest"] == result["digest"]
    assert (
        result["command"] == f"segway-ecc prove fault {scenario} --robot cart-vesc --seed 0 --set plant.Inertia=0.003"
    )


def test_the_packages_scenarios_are_listed_with_their_cases(segway_ecc: Run) -> None:
    outcome = segway_ecc("prove", "fault", "--list")
    names = [name for name, _ in load_all([])]
    assert [line.split()[0] for line in outcome.out.splitlines()] == names
    assert [entry["name"] for entry in json.loads(segway_ecc("prove", "fault", "--list", "--json").out)] == names


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ((), 2, "which scenario?"),
        (("nowhere",), 2, "cannot read scenario 'nowhere'"),
        (("can-cut", "--seed", "-1"), 2, "--seed must not be negative"),
        (("can-cut", "--set", "Inertia=1"), 2, "must begin with model. or plant."),
        (("can-cut", "--set", "plant.Inertia=1", "--set", "plant.Inertia=2"), 2, "--set names 'plant.Inertia' twice"),
        (("can-cut", "--set", "plant.Inertia=1_0"), 2, "could not convert string to float: '1_0'"),
        (("can-cut", "--set", "plant.Inertia"), 2, "write plant.NAME=VALUE"),
        (("can-cut", "--set", "plant.Weight=1"), 3, "Weight"),
        (("can-cut", "--robot", "tank"), 2, "cannot read robot file 'tank'"),
    ],
)
def test_what_cannot_be_run_is_reported_in_one_line(
    segway_ecc: Run, words: tuple[str, ...], code: int, message: str
) -> None:
    outcome = segway_ecc("prove", "fault", *words)
    assert outcome.code == code
    (line,) = outcome.errors
    assert message in line
