# SPDX-License-Identifier: MIT
"""`segway-ecc design commission` on a simulated robot."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from segway_ecc.node.commissioning import read_report
from tests.command import Outcome


def test_error_is_reported_as_a_table_and_kept(segway_ecc: Callable[..., Outcome], tmp_path: Path) -> None:
    path = tmp_path / "report.yaml"
    words = ("design", "commission", "segway", "--simulated", "--error", "left encoder reversed", "--out", str(path))

    outcome = segway_ecc(*words)

    assert outcome.code == 1
    assert "encoders  refused  the left encoder is reversed" in outcome.out
    assert outcome.out.splitlines()[-1] == f"NOT commissioned: {path}"
    report = read_report(path)
    assert report.is_simulated
    assert [step.verdict for step in report.steps] == ["passed", "refused"]


def test_json_has_every_step(segway_ecc: Callable[..., Outcome]) -> None:
    outcome = segway_ecc("design", "commission", "segway", "--simulated", "--error", "IMU frozen", "--json")

    document = json.loads(outcome.out)
    assert outcome.code == 1
    assert [(step["step"], step["verdict"]) for step in document["steps"]] == [("signals", "refused")]


def test_errors_are_listed(segway_ecc: Callable[..., Outcome]) -> None:
    outcome = segway_ecc("design", "commission", "segway", "--error", "list")
    assert outcome.code == 0
    assert "drives swapped" in outcome.out.splitlines()


def test_unknown_error_is_refused(segway_ecc: Callable[..., Outcome]) -> None:
    outcome = segway_ecc("design", "commission", "segway", "--simulated", "--error", "gremlins")
    assert outcome.code == 2
    assert outcome.errors == ["segway-ecc: --error: there is no 'gremlins'; --error list names them"]


@pytest.mark.parametrize("words", [("--error", "drives swapped"), ("--kill",)])
def test_options_of_a_simulated_robot_are_refused_for_a_real_one(
    segway_ecc: Callable[..., Outcome], words: Sequence[str]
) -> None:
    outcome = segway_ecc("design", "commission", "segway", *words)
    assert outcome.code == 2
    assert outcome.errors == [f"segway-ecc: {words[0]} is of a simulated robot: add --simulated"]


def test_robot_that_is_no_segway_is_refused(segway_ecc: Callable[..., Outcome]) -> None:
    outcome = segway_ecc("design", "commission", "cart", "--simulated")
    assert outcome.code == 8
    assert len(outcome.errors) == 1
