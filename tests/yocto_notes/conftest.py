# SPDX-License-Identifier: MIT
"""The layer's files, read as plain text: no bitbake is needed for that."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


class Metadata:
    """The assignments of a bitbake file, unexpanded; a later `+=` is added to what stands before it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = path.read_text(encoding="utf-8")
        self.values: dict[str, str] = {}
        joined = self.text.replace("\\\n", " ")
        for name, operator, value in re.findall(r'^([\w:${}\[\]./-]+) *(\+=|\?=|:=|=) *"(.*)"$', joined, re.MULTILINE):
            before = self.values.get(name, "") if operator == "+=" else ""
            self.values[name] = f"{before} {value}".strip()

    def words(self, name: str) -> list[str]:
        """The words of a variable; none where it is not set."""
        return self.values.get(name, "").split()

    @property
    def name(self) -> str:
        """The recipe's name, before the underscore."""
        return self.path.stem.split("_")[0]

    @property
    def version(self) -> str:
        """The recipe's version, after the underscore."""
        return self.path.stem.partition("_")[2]


@pytest.fixture(scope="session")
def notes() -> Path:
    """The folder with all there is for Yocto."""
    return ROOT / "yocto-notes"


@pytest.fixture(scope="session")
def layer(notes: Path) -> Path:
    """The layer."""
    return notes / "meta-segway-ecc"


@pytest.fixture(scope="session")
def recipes(layer: Path) -> dict[str, Metadata]:
    """Every recipe by its name."""
    found = {recipe.name: recipe for recipe in map(Metadata, sorted(layer.rglob("*.bb")))}
    assert "segway-ecc" in found
    return found


@pytest.fixture(scope="session")
def metadata(layer: Path) -> list[Metadata]:
    """Every recipe, append, include and configuration."""
    return [Metadata(path) for pattern in ("*.bb", "*.bbappend", "*.inc", "*.conf") for path in layer.rglob(pattern)]
