# SPDX-License-Identifier: MIT
"""The verb: designs anew what the packaged files have, and writes a robot file without harm to the rest of it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.design.robot_text import rounded
from segway_ecc.hil.verbs.design_gains import designed, pole_text
from segway_ecc.node.config import load_robot, read_text
from tests.drawn_texts import hard_numbers

Run = Callable[..., Any]
ROBOTS = ["segway", "segway-odrive"]


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_packaged_gains_are_those_of_a_design_made_anew(robot: str) -> None:
    file = load_robot(robot)
    assert file.model.parameters == pytest.approx(rounded(designed(file).gains), rel=1e-4)


def test_it_prints_poles_and_margins(segway_ecc: Run) -> None:
    outcome = segway_ecc("design", "gains", "segway")
    rows = dict(line.split("  ", maxsplit=1) for line in outcome.out.splitlines())
    assert outcome.code == 0
    # The falling body alone: sqrt(m g l M / (M J - (m l)^2)) of the published numbers.
    assert rows["balance: open-loop poles, rad/s"].split()[0] == "9.697,"
    assert {"balance: gain margin", "balance: phase margin", "balance: delay margin", "PitchGain"} <= set(rows)


def test_poles_of_rounding_are_none_and_numbers_are_short(segway_ecc: Run) -> None:
    out = segway_ecc("design", "gains", "segway").out
    rows = dict(line.split("  ", maxsplit=1) for line in out.splitlines())
    # A body that may stand anywhere, at any speed: two poles at zero, which come out some 1e-8 apart.
    assert rows["balance: open-loop poles, rad/s"].split() == ["9.697,", "0,", "0,", "-9.697"]
    assert rows["yaw: open-loop poles, rad/s"].split() == ["0,", "0"]
    # Two integrators under feedback of both states stay stable however small the gain is; it was times 1.459e-08.
    assert rows["yaw: gain margin"].split() == ["up", "to", "times", "43.81"]
    assert hard_numbers(out.splitlines()) == []


@pytest.mark.parametrize(
    ("poles", "text"),
    [
        ([9.69712, 1.46e-8j, -1.46e-8j, -9.69712], "9.697, 0, 0, -9.697"),
        ([0.9 + 0.012345j, 0.9 - 0.012345j, 0.5 + 1e-9j, 0.5 - 1e-9j], "0.9 +- 0.01235j, 0.5, 0.5"),
        ([0.0, 0.0], "0, 0"),
        ([], ""),
    ],
)
def test_poles_are_told_in_a_row(poles: list[complex], text: str) -> None:
    assert pole_text(poles) == text


def test_json_has_the_same(segway_ecc: Run) -> None:
    outcome = segway_ecc("design", "gains", "segway", "--json", "--delay", "1")
    found = json.loads(outcome.out)
    assert found["gains"]["SentBeforeGain"] == 0.0
    assert found["balance"]["delay_margin_s"] > 0.02
    assert len(found["balance"]["closed_poles_z"]) == 6


def test_out_writes_the_robot_file_with_new_gains_and_the_rest_untouched(segway_ecc: Run, tmp_path: Path) -> None:
    out = tmp_path / "mine.yaml"
    outcome = segway_ecc("design", "gains", "segway", "--delay", "0", "--out", str(out))
    before, after = read_text("segway").splitlines(), out.read_text(encoding="utf-8").splitlines()
    changed = [line.split(":")[0].strip() for line in set(after) - set(before)]
    assert outcome.errors == [f"segway-ecc: wrote {out}"]
    assert "SentGain" in changed
    assert set(changed) <= set(load_robot("segway").model.parameters)
    assert load_robot(str(out)).model.parameters["SentGain"] == 0.0
    assert after[0].startswith("# A segway")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("cart-can",), "plant 'cart-"),
        (("cart",), "robot 'cart' has no plant: "),
        (("segway", "--out", "/nowhere/x.yaml"), "cannot write robot file '/nowhere/x.yaml': "),
    ],
)
def test_no_segway_or_an_unwritable_file_is_reported(segway_ecc: Run, words: tuple[str, ...], message: str) -> None:
    outcome = segway_ecc("design", "gains", *words)
    (line,) = outcome.errors
    assert outcome.code != 0
    assert line.startswith(f"segway-ecc: {message}")


def test_other_parameters_of_the_robot_file_are_kept(segway_ecc: Run, tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(
        read_text("segway").replace("  parameters:\n", "  parameters:\n    MaxSpeed: 0.7\n"), encoding="utf-8"
    )
    assert segway_ecc("design", "gains", str(mine), "--out", str(mine)).code == 0
    assert load_robot(str(mine)).model.parameters == {**load_robot("segway").model.parameters, "MaxSpeed": 0.7}
