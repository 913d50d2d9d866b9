# SPDX-License-Identifier: MIT
"""Only regular files of the folder are logs, whatever name is asked for."""

import os
from pathlib import Path

import pytest

from segway_ecc.deploy.support.archive_files import logs_in, open_log
from tests.open_files import open_files


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "logs"
    (place / "folder").mkdir(parents=True)
    (tmp_path / "secret").write_text("secret")
    for age, name in enumerate(("new.mcap", "old.mcap", ".hidden", "folder/inner")):
        (place / name).write_bytes(b"0123456789")
        os.utime(place / name, ns=(0, 1_000_000_000_000_000_000 - age))
    (place / "link").symlink_to(tmp_path / "secret")
    os.mkfifo(place / "pipe")
    return place


def test_logs_are_listed_newest_first(folder: Path) -> None:
    assert [tuple(log) for log in logs_in(folder)] == [
        ("new.mcap", 10, 1_000_000_000_000_000_000),
        ("old.mcap", 10, 999_999_999_999_999_999),
    ]
    assert logs_in(folder / "nowhere") == []


def test_a_log_is_opened_with_its_size(folder: Path) -> None:
    file, size = open_log(folder, "new.mcap")
    with os.fdopen(file, "rb") as stream:
        assert (stream.read(), size) == (b"0123456789", 10)


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "../secret", "/etc/passwd", "folder", "folder/inner", ".hidden", "link", "pipe", "a\0b", "\ud800"],
)
def test_nothing_else_is_opened(folder: Path, name: str) -> None:
    with pytest.raises(FileNotFoundError):
        open_log(folder, name)
    assert not [file for file in open_files() if file == "/etc/passwd" or Path(file).is_relative_to(folder.parent)]


def test_a_folder_that_is_not_there_has_no_logs(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        open_log(tmp_path / "nowhere", "a")


RUNS = ("cart-20261126T101500Z-12.mcap", "cart-can-20261126T101500Z-12.mcap", "by hand.mcap")


def _of(folder: Path, *robots: str) -> set[str]:
    return {log.name for log in logs_in(folder, robots)}


def test_logs_of_other_robots_runs_are_neither_listed_nor_opened(tmp_path: Path) -> None:
    for name in RUNS:
        (tmp_path / name).touch()
    assert _of(tmp_path, "cart") == {"cart-20261126T101500Z-12.mcap", "by hand.mcap"}
    assert _of(tmp_path, "cart-can") == {"cart-can-20261126T101500Z-12.mcap", "by hand.mcap"}
    assert _of(tmp_path, "cart", "cart-can") == set(RUNS)
    assert _of(tmp_path) == {"by hand.mcap"}
    os.close(open_log(tmp_path, RUNS[0], ["cart"])[0])
    with pytest.raises(FileNotFoundError):
        open_log(tmp_path, RUNS[1], ["cart"])
