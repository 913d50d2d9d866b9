# SPDX-License-Identifier: MIT
"""The safety case: every row is shown by tests and scenarios that exist, with the figures of the failure modes."""

import ast
import re
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

import pytest

from segway_ecc.hil.campaign.scenario import load_all, packaged_scenarios

ROOT: Final = Path(__file__).parent.parent
PAGE: Final = ROOT / "docs" / "safety-case.md"
MODES: Final = ROOT / "docs" / "failure-modes.md"
HEAD: Final = ["No.", "Cause", "Measure", "Shown by", "Figure", "Residual risk"]


class Row(NamedTuple):
    number: str
    cause: str
    measure: str
    shown_by: str
    figure: str
    residual: str

    @property
    def scenarios(self) -> list[str]:
        return re.findall(r"`([\w-]+)\.yaml`", self.shown_by)

    @property
    def tests(self) -> list[tuple[str, str]]:
        return re.findall(r"`([\w/]+\.py)::(\w+)`", self.shown_by)


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def rows(page: str) -> list[Row]:
    return [Row(*cells(line)) for line in page.splitlines() if re.match(r"\| [A-Z]\d+ \|", line)]


ROWS: Final = rows(PAGE.read_text("utf-8"))
by_number = pytest.mark.parametrize("row", ROWS, ids=[row.number for row in ROWS])


@cache
def functions(path: str) -> frozenset[str]:
    tree = ast.parse((ROOT / "tests" / path).read_text("utf-8"))
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


@cache
def milliseconds_to_zero() -> dict[str, float]:
    """By scenario, the longest time from the failure to zero torque; without those that drive on."""
    found = [cells(line) for line in MODES.read_text("utf-8").splitlines() if "| `" in line]
    return {row[2].strip("`"): float(row[7]) for row in found if row[7]}


def test_the_tables_have_one_head_and_rows_are_numbered_once_and_in_order() -> None:
    heads = [cells(line) for line in PAGE.read_text("utf-8").splitlines() if line.startswith("| No.")]
    numbers = [(row.number[0], int(row.number[1:])) for row in ROWS]
    assert heads == [HEAD] * len({letter for letter, _ in numbers})
    assert numbers == sorted(set(numbers))
    assert len(numbers) > 20


@by_number
def test_a_row_says_what_is_done_and_names_what_shows_it(row: Row) -> None:
    assert row.cause
    assert row.measure
    assert row.figure
    named = [f"`{name}.yaml`" for name in row.scenarios] + [f"`{file}::{test}`" for file, test in row.tests]
    assert ", ".join(sorted(named)) == ", ".join(sorted(row.shown_by.split(", ")))
    assert named


@by_number
def test_what_shows_it_exists(row: Row) -> None:
    assert set(row.scenarios) <= set(packaged_scenarios())
    assert [name for file, name in row.tests if name not in functions(file)] == []


@by_number
def test_a_figure_in_milliseconds_is_the_longest_of_its_scenarios(row: Row) -> None:
    claimed = re.fullmatch(r"([\d.]+) ms", row.figure)
    found = [milliseconds_to_zero()[name] for name in row.scenarios if name in milliseconds_to_zero()]
    if claimed:
        assert float(claimed[1]) == max(found)


def test_the_failure_modes_are_those_of_the_packaged_scenarios_and_all_as_expected() -> None:
    text = MODES.read_text("utf-8")
    assert sorted(re.findall(r"\| `([\w@.+-]+)` \|", text)) == sorted(name for name, _ in load_all([]))
    assert "NOT AS EXPECTED" not in text


def test_a_broken_row_is_found() -> None:
    (row,) = rows("| A1 | x | y | `no-such.yaml`, `test_docs.py::test_no_such` | 1.0 ms | |")
    with pytest.raises(AssertionError):
        test_what_shows_it_exists(row)
    with pytest.raises(AssertionError):
        test_what_shows_it_exists(row._replace(shown_by="`test_docs.py::test_no_such`"))
    with pytest.raises(AssertionError):
        test_a_figure_in_milliseconds_is_the_longest_of_its_scenarios(row._replace(shown_by="`can-cut.yaml`"))
    with pytest.raises(AssertionError):
        test_a_row_says_what_is_done_and_names_what_shows_it(row._replace(shown_by="by inspection"))
