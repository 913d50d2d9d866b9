# SPDX-License-Identifier: MIT
"""What was tried against the station and what came of it is a table, which a run can keep."""

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import pytest

FOLDER: Final = "SEGWAY_ECC_ARTEFACTS"
"""An environment variable: the folder where the table goes, as attacks.json and attacks.md."""

Tried = Callable[[str, str], None]


@pytest.fixture(scope="session")
def _table() -> Iterator[list[tuple[str, str]]]:
    rows: list[tuple[str, str]] = []
    yield rows
    folder = os.environ.get(FOLDER)
    if folder is None:
        return
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    (place / "attacks.json").write_text(json.dumps([{"tried": tried, "outcome": outcome} for tried, outcome in rows]))
    lines = ["| Tried | Outcome |", "|---|---|", *(f"| {tried} | {outcome} |" for tried, outcome in rows)]
    (place / "attacks.md").write_text("\n".join(lines) + "\n")


@pytest.fixture
def tried(_table: list[tuple[str, str]]) -> Tried:
    """Called with what was tried and its outcome, once that is asserted."""

    def add(what: str, outcome: str) -> None:
        _table.append((what, outcome))

    return add
