# SPDX-License-Identifier: MIT
"""`segway-ecc prove placement`: tables or JSON, a page, and what is refused."""

import json
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.node.cli.main import main


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The quick study, with its report."""
    out = tmp_path_factory.mktemp("study") / "new" / "out"
    assert main(["prove", "placement", "--quick", "--jobs", "1", "--out", str(out)]) == 0
    return out, json.loads((out / "placement.json").read_bytes())


def of(rows: list[dict[str, Any]], *places: str, setpoints: str = "") -> dict[str, Any]:
    (row,) = [
        row
        for row in rows
        if (row["sequence"], row["balance"], row["supervision"], row["setpoints"]) == (*places, setpoints)
    ]
    return row


def test_the_recommended_placement_keeps_balance_on_the_robot(study: tuple[Path, dict[str, Any]]) -> None:
    _, document = study
    best = {"sequence": "station", "balance": "robot", "supervision": "station", "setpoints": "cmd_vel_stamped"}
    assert document["recommended"] == best
    assert document["recommended_by_network"] == {"50 ms": best}


def test_what_comes_of_50_ms_is_in_the_document(study: tuple[Path, dict[str, Any]]) -> None:
    _, document = study
    drives, stops, cuts = document["drives"], document["stops"], document["cuts"]
    assert of(drives, "robot", "robot", "robot")["max_position_m"] == 0.0
    assert of(drives, "station", "robot", "station", setpoints="cmd_vel_stamped")["max_position_m"] == 0.0
    # 0.5 m/s for 50 ms, and some more in the curve.
    assert 0.024 < of(drives, "station", "robot", "station", setpoints="cmd_vel")["max_position_m"] < 0.04
    assert of(drives, "station", "station", "station")["outcome"] == "never stood up"
    (zero_s,) = of(stops, "station", "robot", "station", setpoints="cmd_vel_stamped")["zero_s"]
    assert 0.05 <= zero_s <= 0.065
    assert of(stops, "station", "station", "station")["zero_s"] == [None]
    assert of(cuts, "station", "robot", "station", setpoints="cmd_vel_stamped")["outcome"] == "drove on"
    assert of(cuts, "station", "station", "station")["outcome"] == "fell"


def test_the_tolerated_delay_stands_beside_the_margin_of_the_design(study: tuple[Path, dict[str, Any]]) -> None:
    _, document = study
    (bound,) = document["bounds"]
    assert bound["theory"] == pytest.approx(0.032, abs=0.0005)  # docs/segway.md
    assert bound["tolerated"] < bound["lost"]


def test_the_page_is_written(study: tuple[Path, dict[str, Any]]) -> None:
    out, _ = study
    page = (out / "placement.html").read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert "sequence and supervision on the station, cmd_vel_stamped" in page


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["prove", "placement", "--jobs", "0"], "--jobs must be at least 1, not 0"),
    ],
)
def test_what_cannot_be_is_refused(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(words)
    except SystemExit as exited:  # how argparse ends a command
        code = int(exited.code or 0)
    assert code == 2
    assert message in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_reported_before_the_study(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert main(["prove", "placement", "--out", str(tmp_path / "file" / "out")]) == 2
    assert "choose another --out" in capsys.readouterr().err
