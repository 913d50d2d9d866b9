# SPDX-License-Identifier: MIT
"""`segway-ecc prove campaign`: many scenarios, one report and one exit code."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Run = Callable[..., Any]

SCENARIO = """
name: {name}
robot: cart-can
segments: [{{linear: 1.0, duration: 1.0}}]
faults: [{{target: can, type: off, at_s: 0.5}}]
expect: {{outcome: {outcome}}}
"""


def write(folder: Path, name: str, outcome: str) -> str:
    path = folder / f"{name}.yaml"
    path.write_text(SCENARIO.format(name=name, outcome=outcome), encoding="utf-8")
    return str(path)


def test_a_campaign_as_expected_ends_with_0_and_writes_its_report(segway_ecc: Run, tmp_path: Path) -> None:
    good, out = write(tmp_path, "good", "faults"), tmp_path / "new" / "out"
    outcome = segway_ecc("prove", "campaign", good, "--jobs", "1", "--seeds", "2", "--out", str(out))
    assert outcome.code == 0
    assert outcome.out.splitlines()[-1] == "2 of 2 runs as expected"
    assert outcome.errors[0] == f"segway-ecc: report in {out / 'campaign.html'}"
    assert (out / "campaign.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert "| `good` | cart-can | 2 | faults |" in (out / "failure-modes.md").read_text(encoding="utf-8")
    runs = json.loads((out / "campaign.json").read_bytes())["runs"]
    assert [run["seed"] for run in runs] == [0, 1]
    assert f"segway-ecc prove fault {good} --robot cart-can --seed 1" == runs[1]["command"]


def test_one_run_that_is_not_as_expected_ends_it_with_1(segway_ecc: Run, tmp_path: Path) -> None:
    files = [write(tmp_path, "good", "faults"), write(tmp_path, "bad", "holds")]
    outcome = segway_ecc("prove", "campaign", *files, "--jobs", "1", "--json")
    document = json.loads(outcome.out)
    assert outcome.code == 1
    assert document["as_expected"] is False
    assert [run["as_expected"] for run in document["runs"]] == [True, False]
    assert document["runs"][1]["why_not"] == ["outcome faults, not holds"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("nowhere",), "cannot read scenario 'nowhere'"),
        (("can-cut", "--jobs", "0"), "--jobs must be at least 1, not 0"),
        (("can-cut", "--seeds", "0"), "--seeds must be at least 1, not 0"),
        (("can-cut", "--sample", "0"), "--sample must be at least 1, not 0"),
        (("can-cut", "--floor", "9"), "--floor must be within 0.01 to 5, not 9"),
    ],
)
def test_what_cannot_be_run_is_reported_in_one_line(segway_ecc: Run, words: tuple[str, ...], message: str) -> None:
    outcome = segway_ecc("prove", "campaign", *words)
    assert outcome.code == 2
    (line,) = outcome.errors
    assert message in line


def test_a_report_that_cannot_be_written_is_an_error(segway_ecc: Run, tmp_path: Path) -> None:
    good = write(tmp_path, "good", "faults")
    outcome = segway_ecc("prove", "campaign", good, "--jobs", "1", "--out", str(Path(good) / "below"))
    assert outcome.code == 2
    assert "cannot write to" in outcome.errors[-1]


@pytest.mark.mujoco
def test_on_a_floor_each_run_is_made_twice_and_compared(segway_ecc: Run, tmp_path: Path) -> None:
    words = ("segway_can-cut", "segway_can-late", "--floor", "0.8", "--sample", "1", "--jobs", "1")
    outcome = segway_ecc("prove", "campaign", *words, "--out", str(tmp_path))
    assert "| `segway_can-cut` | segway, segway-odrive | 1 |" in (tmp_path / "failure-modes.md").read_text(
        encoding="utf-8"
    )
    document = json.loads((tmp_path / "campaign.json").read_bytes())
    assert [run["floor"] for run in document["runs"]] == [None, 0.8]
    lines = outcome.out.splitlines()
    assert "segway  " in lines[1]
    assert "segway, friction 0.8" in lines[2] or "segway-odrive, friction 0.8" in lines[2]
    assert lines[-1].endswith("of 1 runs end otherwise on a floor with a friction of 0.8")


@pytest.mark.mujoco
def test_a_floor_is_for_segways(segway_ecc: Run) -> None:
    outcome = segway_ecc("prove", "campaign", "can-cut", "--floor", "0.8")
    assert outcome.code == 2
    assert "none of these scenarios is of a segway" in outcome.errors[-1]


def test_a_floor_needs_mujoco(segway_ecc: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("segway_ecc.hil.verbs.prove_campaign.lacks_mujoco", lambda: "pip install it")
    outcome = segway_ecc("prove", "campaign", "segway_can-cut", "--floor", "0.8")
    assert outcome.code == 2
    assert outcome.errors[-1] == "segway-ecc: --floor needs MuJoCo: pip install it"
