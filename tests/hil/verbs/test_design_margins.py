# SPDX-License-Identifier: MIT
"""The search, over a robot that is made up; and one real run to either side of a limit."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.design import balance_margins
from segway_ecc.hil.design.balance_margins import disturbances, find_limit, recovers
from segway_ecc.hil.floor import margins as floor_margins
from segway_ecc.hil.verbs import design_margins
from segway_ecc.node.config import load_robot
from segway_ecc.node.models.segway_parameters import PUBLISHED

Run = Callable[..., Any]
KINDS = {kind.name: kind for kind in disturbances(PUBLISHED)}


def tolerates(monkeypatch: pytest.MonkeyPatch, largest: float) -> None:
    def pretend(_file: object, _kind: object, size: float, seed: int, **_: float) -> bool:
        return abs(size) <= largest / seed

    monkeypatch.setattr(balance_margins, "recovers", pretend)
    monkeypatch.setattr(floor_margins, "recovers", pretend)


@pytest.mark.parametrize("name", ["push ahead, 0.1 s", "push back, 0.1 s"])
def test_the_limit_is_found_to_its_resolution_for_the_worst_seed(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    tolerates(monkeypatch, 61.0)
    limit = find_limit(load_robot("segway"), KINDS[name], (1, 2))
    assert 29.5 <= abs(limit.tolerated) <= 30.5
    assert (limit.tolerated > 0.0) == (KINDS[name].most > 0.0)
    assert not limit.is_beyond


def test_a_robot_that_tolerates_the_largest_size_is_beyond(monkeypatch: pytest.MonkeyPatch) -> None:
    tolerates(monkeypatch, 1e9)
    limit = find_limit(load_robot("segway"), KINDS["slope, up"], (1,))
    assert (limit.tolerated, limit.is_beyond, limit.is_enough) == (0.4, True, True)


@pytest.mark.parametrize(("largest", "code"), [(0.5, 0), (0.01, 1)])
def test_the_verb_prints_what_is_not_met(
    segway_ecc: Run, monkeypatch: pytest.MonkeyPatch, largest: float, code: int
) -> None:
    tolerates(monkeypatch, largest)
    words = ("design", "margins", "--only", "slope", "--seeds", "1")
    table, found = segway_ecc(*words), json.loads(segway_ecc(*words, "--json").out)
    assert table.code == code
    assert table.out.count("NOT MET") == 2 * code
    assert table.errors == ["segway-ecc: slope, up", "segway-ecc: slope, down"]
    assert [limit["is_enough"] for limit in found["limits"]] == [not code, not code]
    assert [limit["required"] for limit in found["limits"]] == pytest.approx([0.0873, -0.0873], abs=1e-4)


@pytest.mark.mujoco
def test_each_limit_against_friction_names_its_plant(
    segway_ecc: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    tolerates(monkeypatch, 0.05)
    words = ("design", "margins", "--only", "slope", "--seeds", "1", "--friction", "0.6", "1.2", "--jobs", "1")
    outcome = segway_ecc(*words, "--out", str(tmp_path))
    lines = outcome.out.splitlines()
    assert lines[0] == "plant segway-plant: wheels never slip; least of 1 seeds"
    assert lines[5] == "plant segway-contact-plant: wheels slip, by the friction of each column; least of 1 seeds"
    assert lines[7].split() == ["slope,", "up", "rad", "0.05", "!", "0.05", "!", "0.0873"]
    assert lines[-1].startswith("beyond the hardware: on a friction below 0.447 ")
    assert outcome.code == 1
    document = json.loads((tmp_path / "margins.json").read_bytes())
    assert [limit["friction"] for limit in document["floor"]] == [0.6, 1.2, 0.6, 1.2]
    assert document["plant"] == "segway-plant"


def test_without_mujoco_the_rest_is_given(segway_ecc: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    tolerates(monkeypatch, 0.5)
    monkeypatch.setattr(design_margins, "lacks_mujoco", lambda: "pip install it")
    outcome = segway_ecc("design", "margins", "--only", "slope", "--seeds", "1", "--friction", "0.6")
    assert outcome.code == 0
    assert outcome.errors[0] == "segway-ecc: no limits against friction: pip install it"
    assert "contact" not in outcome.out


@pytest.mark.parametrize("friction", ["0", "6"])
def test_a_friction_that_no_floor_has_is_refused(segway_ecc: Run, friction: str) -> None:
    outcome = segway_ecc("design", "margins", "--friction", friction)
    assert outcome.code == 2
    assert f"--friction must be within 0.01 to 5, not {friction}" in outcome.errors[0]


@pytest.mark.parametrize(("force", "expected"), [(40.0, True), (200.0, False)])
def test_a_push_is_tolerated_or_not(force: float, expected: bool) -> None:  # noqa: FBT001 - a parameter of the test
    assert recovers(load_robot("segway"), KINDS["push ahead, 0.1 s"], force, 1) is expected
