# SPDX-License-Identifier: MIT
"""The kas files, checked by kas' own schema; nothing is fetched."""

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
KAS = ROOT / "yocto-notes" / "kas"
FILES = [KAS / name for name in ("base.yml", "segway-ecc-qemux86-64.yml", "segway-ecc-raspberrypi4-64.yml")]


def _load(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_the_schema_of_kas_accepts_it(path: Path) -> None:
    schema = import_module("kas.configschema").CONFIGSCHEMA

    import_module("jsonschema").Draft7Validator(schema).validate(_load(path))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_what_it_includes_and_our_own_layer_exist(path: Path) -> None:
    loaded = _load(path)
    layers = loaded.get("repos", {}).get("segway-ecc", {}).get("layers", {})

    assert [each for each in loaded["header"].get("includes", []) if not (ROOT / each).is_file()] == []
    assert [each for each in layers if not (ROOT / each / "conf" / "layer.conf").is_file()] == []


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_a_repository_is_of_one_branch_or_of_one_commit(path: Path) -> None:
    for name, repo in _load(path).get("repos", {}).items():
        if name != "segway-ecc":
            assert repo["url"].startswith("https://"), name
            assert re.fullmatch(r"[0-9a-f]{40}", repo.get("commit", "0" * 40)), name


def test_no_file_lets_anybody_in_without_a_key() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in FILES)

    assert not re.search(r"debug-tweaks|empty-root-password|allow-empty-password", text)
    assert "SEGWAY_ECC_AUTHORIZED_KEYS" in text
