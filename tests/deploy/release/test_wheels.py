# SPDX-License-Identifier: MIT
"""What pip collects, with a pip that answers as the real one does."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from segway_ecc.deploy.release import wheels
from segway_ecc.deploy.release.wheels import Target
from segway_ecc.node.errors import ConfigurationError
from tests.deploy.release.parts import make_wheel

TARGET = Target("3.11", "x86_64", ("manylinux_2_36_x86_64",), system_ros=False, robot_files={}, has_robot_file=True)


class Index:
    """An index, and a pip that asks it.

    Args:
        sources: What it has as source only: the wheel that comes of each.
    """

    def __init__(self, sources: dict[str, str]) -> None:
        self.sources = sources
        self.asked: list[str] = []

    def pip(self, words: Sequence[str]) -> subprocess.CompletedProcess[str]:
        self.asked.append(f"{words[0]}{' offline' if '--no-index' in words else ''}")
        if words[0] == "wheel":
            Path(words[words.index("--wheel-dir") + 1], self.sources[words[-1]]).touch()
            return subprocess.CompletedProcess(words, 0, "", "")
        cache, dest = (Path(words[words.index(option) + 1]) for option in ("--find-links", "--dest"))
        lacking = next((name for name, wheel in self.sources.items() if not (cache / wheel).exists()), None)
        if lacking is not None:
            # As pip 23 to 26 print it.
            text = f"ERROR: Could not find a version\nERROR: No matching distribution found for {lacking}\n"
            return subprocess.CompletedProcess(words, 1, "", text)
        (dest / "numpy-2.0-cp311-cp311-manylinux_2_28_x86_64.whl").touch()
        for wheel in self.sources.values():
            (dest / wheel).touch()
        return subprocess.CompletedProcess(words, 0, "", "")


def collected(monkeypatch: pytest.MonkeyPatch, folder: Path, index: Index) -> list[str]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    monkeypatch.setattr(wheels, "_pip", index.pip)
    dest = folder / "dest"
    dest.mkdir(exist_ok=True)
    ours = make_wheel(folder, "1.0")
    return [path.name for path in wheels.collect(ours, ["ros"], TARGET, dest, refresh=False)]


def test_what_there_is_as_source_only_is_built_here_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As `empy`, which ROS 2 from PyPI needs."""
    index = Index({"empy<4": "empy-3.3-py3-none-any.whl", "other": "other-1-py2.py3-none-any.whl"})
    found = collected(monkeypatch, tmp_path, index)
    assert {"empy-3.3-py3-none-any.whl", "other-1-py2.py3-none-any.whl"} < set(found)
    assert index.asked == ["download offline", "download", "wheel", "download", "wheel", "download"]
    index.asked.clear()
    assert collected(monkeypatch, tmp_path, index) == found
    assert index.asked == ["download offline"]


def test_what_would_be_built_for_this_machine_only_is_not_taken(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    index = Index({"drive": "drive-1-cp311-cp311-linux_x86_64.whl"})
    with pytest.raises(ConfigurationError, match="No matching distribution found for drive"):
        collected(monkeypatch, tmp_path, index)
    assert index.asked == ["download offline", "download", "wheel"]
    assert not list((tmp_path / "cache").rglob("*.whl"))


def test_an_index_that_cannot_be_reached_is_asked_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked = []

    def pip(words: Sequence[str]) -> subprocess.CompletedProcess[str]:
        asked.append(words[0])
        return subprocess.CompletedProcess(words, 1, "", "ERROR: Could not find a version\nERROR: no route to host\n")

    index = Index({})
    monkeypatch.setattr(index, "pip", pip)
    with pytest.raises(ConfigurationError, match=r"cannot be collected: no route to host$"):
        collected(monkeypatch, tmp_path, index)
    assert asked == ["download", "download"]
