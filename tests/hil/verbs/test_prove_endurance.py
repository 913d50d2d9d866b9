# SPDX-License-Identifier: MIT
"""`segway-ecc prove endurance`: what it prints, and how it ends."""

import json
from collections.abc import Callable, Sequence
from typing import Any

import pytest

from segway_ecc.hil.endurance.endurance import EndurancePlan, Stretch, Trip
from segway_ecc.hil.verbs import prove_endurance

Run = Callable[..., Any]
GOOD = Stretch(1, 1800.0, 360_000, None, 0.12, 0.05, 0.01, 1000, 10, 0)
BAD = Stretch(2, 1800.0, 360_000, Trip(7.5, "FAULT", "left.angle is too old"), 0.5, 0.04, 0.02, 1000, 12, 3)


def pretend(monkeypatch: pytest.MonkeyPatch, stretches: Sequence[Stretch]) -> list[tuple[EndurancePlan, int]]:
    asked = []

    def endure(plan: EndurancePlan, jobs: int, _on_progress: object) -> list[Stretch]:
        asked.append((plan, jobs))
        return list(stretches)

    monkeypatch.setattr(prove_endurance, "endure", endure)
    return asked


@pytest.mark.parametrize(("stretches", "code"), [([GOOD, GOOD], 0), ([GOOD, BAD], 1)])
def test_a_trip_is_reported_and_is_exit_code_1(
    segway_ecc: Run, monkeypatch: pytest.MonkeyPatch, stretches: Sequence[Stretch], code: int
) -> None:
    asked = pretend(monkeypatch, stretches)
    words = [
        "prove",
        "endurance",
        "segway-odrive",
        "--hours",
        "2",
        "--frame-loss",
        "0.03",
        "--seeds",
        "3",
        "--jobs",
        "5",
    ]
    words += ["--channel", "can7"]
    table, document = segway_ecc(*words), json.loads(segway_ecc(*words, "--json").out)
    assert table.code == code
    assert (asked[0][0].file.name, *asked[0][0][1:], asked[0][1]) == ("segway-odrive", 7200.0, 0.03, 3, (), "can7", 3)
    assert (document["simulated_hours"], document["cycles"], document["trips"]) == (1.0, 720_000, code)
    assert ("left.angle is too old" in table.out) is bool(code)


def test_the_figures_are_those_of_all_robots_together(segway_ecc: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, [GOOD, BAD])
    document = json.loads(segway_ecc("prove", "endurance", "--json").out)
    assert document["why"] == [{"seed": 2, "at_s": 7.5, "mode": "FAULT", "reason": "left.angle is too old"}]
    assert (document["max_tilt_rad"], document["max_velocity_error"], document["max_yaw_rate_error"]) == (
        0.5,
        0.05,
        0.02,
    )
    assert (document["frames"], document["frames_lost"], document["frames_refused"]) == (2000, 22, 3)


def test_a_short_drive_for_real(segway_ecc: Run) -> None:
    outcome = segway_ecc("prove", "endurance", "--hours", "0.001", "--seeds", "1")
    assert outcome.code == 0
    assert "0.00 h, 720 cycles" in outcome.out
    assert outcome.errors == []


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--hours", "0"), "--hours must be more than 0"),
        (("--frame-loss", "1"), "--frame-loss must be from 0 to less than 1"),
        (("--seeds", "0"), "--seeds must be at least 1"),
        (("--jobs", "0"), "--jobs must be at least 1"),
    ],
)
def test_nonsense_is_refused(segway_ecc: Run, words: tuple[str, str], text: str) -> None:
    outcome = segway_ecc("prove", "endurance", *words)
    assert outcome.code == 2
    assert text in outcome.errors[0]
