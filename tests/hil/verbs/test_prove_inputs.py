# SPDX-License-Identifier: MIT
"""`segway-ecc prove inputs`: which inputs, the table and the exit code, with a stand-in for the robots."""

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.drill.plant_control import Torque
from segway_ecc.hil.inputs import table, trial
from segway_ecc.hil.inputs.table import ITEMS, all_trials
from segway_ecc.hil.inputs.trial import InputResult, InputTrial
from segway_ecc.hil.verbs import prove_inputs
from segway_ecc.hil.witness import Stalls

Run = Callable[..., Any]


class Robots:
    """Stands in for real ones: all comes as declared, but for what is told by name."""

    def __init__(self) -> None:
        self.given: list[InputTrial] = []
        self.told: dict[str, InputResult] = {}
        self.stalls_of = Stalls()

    @contextlib.contextmanager
    def witness(self, _messages: Path) -> Iterator["Robots"]:
        yield self

    def stalls(self) -> Stalls:
        return self.stalls_of

    def __call__(self, trials: Sequence[InputTrial], _start: object) -> Iterator[InputResult]:
        for each in trials:
            self.given.append(each)
            limit_s = each.declared.zero_within_s
            torque = Torque(1.0, None, 0.0) if limit_s is None else Torque(0.0123, 0.015, 0.0)
            text = each.declared.text
            yield self.told.get(each.name) or InputResult(each.item, each.name, text, text, "because", torque, limit_s)


@pytest.fixture
def robots(monkeypatch: pytest.MonkeyPatch) -> Robots:
    found = Robots()
    monkeypatch.setattr(trial, "run_all", found)
    monkeypatch.setattr(prove_inputs, "witness", found.witness)
    return found


def test_every_input_on_both_robots_is_the_default_and_all_well_is_zero(segway_ecc: Run, robots: Robots) -> None:
    outcome = segway_ecc("prove", "inputs")

    names = [each.name for each in all_trials()]
    assert outcome.code == 0
    assert [each.name for each in robots.given] == names * 2
    assert outcome.out.splitlines()[-1] == f"{2 * len(names)} of {2 * len(names)} inputs as declared"
    assert outcome.errors == [
        f"segway-ecc: {robot}: {len(names)} of {len(names)} runs done" for robot in ("segway", "segway-odrive")
    ]


def test_one_item_of_one_robot(segway_ecc: Run, robots: Robots) -> None:
    outcome = segway_ecc("prove", "inputs", "--robot", "segway", "--item", "5")

    assert {each.item for each in robots.given} == {5}
    assert [" ".join(line.split()) for line in outcome.out.splitlines()] == [
        "segway",
        "item input declared outcome zero, ms limit, ms verdict",
        "5 no telemetry for 20 ms ARMED, BALANCING ARMED, BALANCING goes on - as declared",
        "because",
        "5 no telemetry for 50 ms ARMED, BALANCING ARMED, BALANCING goes on - as declared",
        "because",
        "5 no telemetry for 80 ms FAULT, FALLEN FAULT, FALLEN 12.3 100 as declared",
        "because",
        "",
        "3 of 3 inputs as declared",
    ]


def test_one_that_is_otherwise_is_exit_code_1(segway_ecc: Run, robots: Robots) -> None:
    name = "no telemetry for 50 ms"
    robots.told[name] = InputResult(5, name, "ARMED", "FAULT", "too old", wrong=("mode FAULT, not ARMED",))
    outcome = segway_ecc("prove", "inputs", "--robot", "segway", "--item", "5")

    assert outcome.code == 1
    assert outcome.errors[0] == f"segway-ecc: segway: 5: {name}: NOT as declared: mode FAULT, not ARMED"
    assert outcome.out.splitlines()[-1] == "2 of 3 inputs as declared"


def test_how_the_machine_stalled_is_said_of_what_was_otherwise(segway_ecc: Run, robots: Robots) -> None:
    name = "no telemetry for 50 ms"
    robots.told[name] = InputResult(5, name, "ARMED", "FAULT", "too old", wrong=("mode FAULT, not ARMED",))
    robots.stalls_of = Stalls(longest_s=0.085)
    outcome = segway_ecc("prove", "inputs", "--robot", "segway", "--item", "5")

    meanwhile = "NOT as declared: mode FAULT, not ARMED; meanwhile the machine stalled for up to 85 ms"
    assert outcome.errors[0] == f"segway-ecc: segway: 5: {name}: {meanwhile}"
    assert outcome.out.count("stalled") == 1
    assert outcome.code == 1


def test_what_was_not_run_is_counted_and_never_as_declared(segway_ecc: Run, robots: Robots) -> None:
    name = "no telemetry for 50 ms"
    robots.told[name] = InputResult(5, name, "ARMED", not_run="no ROS: no rclpy")
    outcome = segway_ecc("prove", "inputs", "--robot", "segway", "--item", "5")

    assert outcome.code == 0
    assert outcome.errors[0] == f"segway-ecc: segway: 5: {name}: not run: no ROS: no rclpy"
    assert outcome.out.splitlines()[-1] == "2 of 2 inputs as declared; 1 not run"


def test_where_nothing_can_be_run_nothing_is_proved(segway_ecc: Run, robots: Robots) -> None:
    for each in all_trials():
        robots.told[each.name] = InputResult(each.item, each.name, "ARMED", not_run="no ROS: no rclpy")
    assert segway_ecc("prove", "inputs", "--robot", "segway", "--item", "1").code == 1


def test_json(segway_ecc: Run, robots: Robots) -> None:
    name = "no telemetry for 50 ms"
    robots.told[name] = InputResult(5, name, "ARMED", not_run="no ROS: no rclpy")
    outcome = segway_ecc("prove", "inputs", "--robot", "segway-odrive", "--item", "5", "--json")
    found = json.loads(outcome.out)

    assert (found["tried"], found["as_declared"], found["not_run"]) == (2, 2, 1)
    assert list(found["robots"]) == ["segway-odrive"]
    rows = found["robots"]["segway-odrive"]
    assert [row["as_declared"] for row in rows] == [True, False, True]
    assert rows[2] == {
        "item": 5,
        "name": "no telemetry for 80 ms",
        "declared": "FAULT, FALLEN",
        "outcome": "FAULT, FALLEN",
        "reason": "because",
        "torque": {"last_s": 0.0123, "zero_s": 0.015, "gap_s": 0.0},
        "limit_s": 0.1,
        "wrong": [],
        "not_run": "",
        "stall": "",
        "as_declared": True,
    }


@pytest.mark.parametrize("words", [("--item", "99"), ("--robot", "cart-can")])
def test_what_is_not_there_is_refused(segway_ecc: Run, robots: Robots, words: tuple[str, str]) -> None:
    assert segway_ecc("prove", "inputs", *words).code == 2
    assert robots.given == []


def test_the_items_are_in_the_help(segway_ecc: Run) -> None:
    text = " ".join(segway_ecc("prove", "inputs", "--help").out.split())
    assert all(f"{number}: {what}" in text for number, what in ITEMS.items())
    assert table.ITEMS is ITEMS
