# SPDX-License-Identifier: MIT
"""Logs within their bounds: the oldest goes first, and never one that is being written."""

import fcntl
import os
import sys
from pathlib import Path

import pytest

from segway_ecc.node.recording.log_quota import (
    LogQuota,
    following_parts,
    lock_log,
    part_path,
    part_paths,
    remove_oldest_logs,
)


def log(folder: Path, name: str, size: int, age: int) -> Path:
    """A file that was written so many seconds before another one of age 0."""
    path = folder / name
    path.write_bytes(bytes(size))
    os.utime(path, (1_000_000 - age, 1_000_000 - age))
    return path


def names(paths: list[Path]) -> list[str]:
    return [path.name for path in paths]


def test_parts_are_numbered_and_found_in_their_order(tmp_path: Path) -> None:
    first = tmp_path / "run.mcap"
    others = ("run-0001.mcap", "run-2.mcap", "run-0002.log", "other-0003.mcap")
    for name in ("run.mcap", "run-0010.mcap", "run-0002.mcap", *others):
        log(tmp_path, name, 1, 0)

    assert names([part_path(first, number) for number in (1, 2, 12)]) == [
        "run.mcap",
        "run-0002.mcap",
        "run-0012.mcap",
    ]
    assert names(part_paths(first)) == ["run.mcap", "run-0002.mcap", "run-0010.mcap"]


def test_the_oldest_logs_of_our_own_folder_go_until_all_fit(tmp_path: Path) -> None:
    for number in range(5):
        log(tmp_path, f"other{number}.mcap", 100, age=number)
    log(tmp_path, "notes.txt", 1000, age=99)
    path = log(tmp_path, "run.mcap", 100, age=50)
    removed = remove_oldest_logs(path, LogQuota(350, 100, is_own_folder=True), 100, path)

    # 600 bytes with 350 allowed: three have to go, though the one being written is older than they are.
    assert names(removed) == ["other4.mcap", "other3.mcap", "other2.mcap"]
    assert sorted(names(list(tmp_path.iterdir()))) == ["notes.txt", "other0.mcap", "other1.mcap", "run.mcap"]


def test_beside_a_file_that_the_user_named_only_parts_of_the_run_go(tmp_path: Path) -> None:
    log(tmp_path, "precious.mcap", 1000, age=99)
    first = log(tmp_path, "run.mcap", 100, age=3)
    log(tmp_path, "run-0002.mcap", 100, age=2)
    present = log(tmp_path, "run-0003.mcap", 100, age=0)

    assert names(remove_oldest_logs(first, LogQuota(250, 100), 100, present)) == ["run.mcap"]
    assert (tmp_path / "precious.mcap").exists()


def test_a_log_that_somebody_writes_stays(tmp_path: Path) -> None:
    other = log(tmp_path, "other.mcap", 100, age=9)
    path = log(tmp_path, "run.mcap", 100, age=0)
    with other.open("rb+") as stream:
        lock_log(stream.fileno())
        assert remove_oldest_logs(path, LogQuota(100, 100, is_own_folder=True), 100, path) == []
        assert other.exists()
    assert names(remove_oldest_logs(path, LogQuota(100, 100, is_own_folder=True), 100, path)) == ["other.mcap"]


def test_what_is_claimed_by_somebody_else_is_no_error(tmp_path: Path) -> None:
    path = log(tmp_path, "run.mcap", 1, 0)
    with path.open("rb") as first, path.open("rb") as second:
        fcntl.flock(first, fcntl.LOCK_EX)
        lock_log(second.fileno())


def test_within_the_bounds_nothing_goes(tmp_path: Path) -> None:
    log(tmp_path, "other.mcap", 100, age=9)
    path = log(tmp_path, "run.mcap", 100, age=0)

    assert remove_oldest_logs(path, LogQuota(200, 100, is_own_folder=True), 100, path) == []


def test_a_look_that_removes_nothing_interns_no_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each would take a place in a table of Python's for good, and a full one is made larger: by 0.5 MB at once."""
    interned: list[str] = []
    log(tmp_path, "run-0002.mcap", 100, age=1)
    path = log(tmp_path, "run.mcap", 100, age=0)

    def intern(text: str) -> str:
        interned.append(text)
        return text

    monkeypatch.setattr(sys, "intern", intern)
    remove_oldest_logs(path, LogQuota(200, 100), 100, path)
    remove_oldest_logs(path, LogQuota(200, 100, is_own_folder=True), 100, path)
    found = interned.copy()
    monkeypatch.undo()

    assert found == []


@pytest.mark.parametrize(
    ("name", "behind"),
    [
        ("run-0002.mcap", ["run-0003.mcap", "run-0010.mcap"]),
        ("run-0010.mcap", []),
        ("run.mcap", []),
        ("run-x.mcap", []),
        ("log", []),
        ("-7", []),
    ],
)
def test_the_parts_behind_a_later_one_are_found_without_the_first(tmp_path: Path, name: str, behind: list[str]) -> None:
    for there in ("run-0002.mcap", "run-0003.mcap", "run-0010.mcap", "run-x.mcap", "other-0004.mcap", "log", "-7"):
        (tmp_path / there).touch()

    assert [path.name for path in following_parts(tmp_path / name)] == behind
