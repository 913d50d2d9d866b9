# SPDX-License-Identifier: MIT
"""`segway-ecc prove growth`: what it prints and writes."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.growth import study
from segway_ecc.hil.growth.cost import Axis, Cost, Point

Run = Callable[..., Any]


@pytest.fixture(autouse=True)
def measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every size costs ten and itself."""

    def measure(axis: Axis) -> Callable[[int], Point]:
        return lambda size: Point(
            axis=axis, size=size, cost=Cost(p50_us=10.0 + size, p99_us=20.0 + size, spread_us=0.1)
        )

    monkeypatch.setattr(study.conduct, "__defaults__", ({axis: measure(axis) for axis in Axis},))
    monkeypatch.setattr(study, "missing_packages", lambda: ())


def test_every_axis_has_its_table_and_its_line(segway_ecc: Run) -> None:
    outcome = segway_ecc("prove", "growth")
    assert outcome.code == 0
    for axis in ("model ports", "drives", "subscribers", "robots"):
        assert f"{axis}: 10.0 us and 1 us for each, linear up to" in outcome.out
    assert outcome.errors[-1].startswith("segway-ecc: the study took")


def test_the_quick_one_needs_no_ros(segway_ecc: Run) -> None:
    document = json.loads(segway_ecc("prove", "growth", "--quick", "--json").out)
    assert [grown["axis"] for grown in document["growth"]] == ["model ports", "drives"]
    assert document["growth"][0]["line"]["per_one"] == pytest.approx(1.0)
    assert len(document["verdicts"]) == 2


def test_the_report_is_written_where_it_is_asked_for(segway_ecc: Run, tmp_path: Path) -> None:
    folder = tmp_path / "new"
    assert segway_ecc("prove", "growth", "--out", str(folder)).code == 0
    assert {path.name for path in folder.glob("growth*")} == {"growth.html", "growth.json", "growth.svg"}
    assert [grown["axis"] for grown in json.loads((folder / "growth.json").read_bytes())][-1] == "robots"
    outcome = segway_ecc("prove", "growth", "--out", "/proc/nowhere")
    assert (outcome.code, "cannot write to /proc/nowhere" in outcome.errors[0]) == (2, True)
