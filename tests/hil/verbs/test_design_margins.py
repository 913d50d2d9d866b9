# SPDX-License-Identifier: MIT
"""The search, over a robot that is made up; and one real run to either side of a limit."""

import json
from collections.abc import Callable
from typing import Any

import pytest

from segway_ecc.hil.design import balance_margins
from segway_ecc.hil.design.balance_margins import disturbances, find_limit, recovers
from segway_ecc.node.config import load_robot
from segway_ecc.node.models.segway_parameters import PUBLISHED

Run = Callable[..., Any]
KINDS = {kind.name: kind for kind in disturbances(PUBLISHED)}


def tolerates(monkeypatch: pytest.MonkeyPatch, largest: float) -> None:
    def pretend(_file: object, _kind: object, size: float, seed: int) -> bool:
        return abs(size) <= largest / seed

    monkeypatch.setattr(balance_margins, "recovers", pretend)


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


@pytest.mark.parametrize(("force", "expected"), [(40.0, True), (200.0, False)])
def test_a_push_is_tolerated_or_not(force: float, expected: bool) -> None:  # noqa: FBT001 - a parameter of the test
    assert recovers(load_robot("segway"), KINDS["push ahead, 0.1 s"], force, 1) is expected
