# SPDX-License-Identifier: MIT
"""A bundle is whole whatever fails in it, and lists what it has and lacks."""

import errno
import hashlib
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.deploy.support.bundle import MANIFEST, Collected, Content, Parts, Stored, write_bundle


def _part(name: str, content: Content, *missing: str) -> Parts:
    return {name: lambda: Collected({f"{name}.txt": content}, missing)}


def _stored(path: Path, size: int) -> Stored:
    return Stored(lambda: os.open(path, os.O_RDONLY), size)


def _write(path: Path, *parts: Parts) -> dict[str, str]:
    manifest = write_bundle(
        path,
        {name: part for each in parts for name, part in each.items()},
        {"robot": "cart"},
        "2026-01-01T00:00:00+00:00",
    )
    return {part.part: part.state for part in manifest.parts}


def test_it_has_every_part_and_a_manifest_with_sizes_and_hashes(tmp_path: Path) -> None:
    log, path = tmp_path / "log", tmp_path / "b.zip"
    log.write_bytes(b"0123456789")
    assert _write(path, _part("a", "text"), _part("log", _stored(log, 7))) == {"a": "complete", "log": "complete"}
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        assert archive.read("a.txt") == b"text"
        assert archive.read("log.txt") == b"0123456"
        manifest = json.loads(archive.read(MANIFEST))
    assert manifest["about"] == {"robot": "cart"}
    assert manifest["parts"][1]["files"] == [
        {"name": "log.txt", "bytes": 7, "sha256": hashlib.sha256(b"0123456").hexdigest()}
    ]
    assert path.stat().st_mode & 0o777 == 0o600
    assert [entry.name for entry in tmp_path.iterdir() if entry.name.startswith(".")] == []


def test_a_part_that_fails_is_named_with_why_and_costs_no_other(tmp_path: Path) -> None:
    def fail() -> Collected:
        raise ValueError("the token=abc broke")

    path = tmp_path / "b.zip"
    states = _write(path, {"bad": fail}, _part("gone", _stored(tmp_path / "gone", 5)), _part("good", "x"))
    assert states == {"bad": "missing", "gone": "missing", "good": "complete"}
    with zipfile.ZipFile(path) as archive:
        assert archive.namelist() == ["good.txt", MANIFEST]
        parts = json.loads(archive.read(MANIFEST))["parts"]
    assert parts[0]["missing"] == ["ValueError: the token=[hidden] broke"]
    assert parts[1]["missing"] == ["gone.txt: FileNotFoundError: No such file or directory"]


def test_what_a_part_lacks_is_named(tmp_path: Path) -> None:
    assert _write(tmp_path / "b.zip", _part("a", "x", "the rest")) == {"a": "partly"}


def test_text_loses_its_secrets_and_a_log_stays_as_it_is(tmp_path: Path) -> None:
    log, path = tmp_path / "log", tmp_path / "b.zip"
    log.write_bytes(b"token=abc")
    _write(path, _part("a", "token=abc"), _part("log", _stored(log, 100)))
    with zipfile.ZipFile(path) as archive:
        assert archive.read("a.txt") == b"token=[hidden]"
        assert archive.read("log.txt") == b"token=abc"


def test_a_log_that_cannot_be_read_to_its_end_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = tmp_path / "log"
    log.write_bytes(bytes(3 * 1024 * 1024))
    read: Callable[[int, int], bytes] = os.read
    calls: list[int] = []

    def failing(file: int, size: int) -> bytes:
        calls.append(size)
        if len(calls) == 2:
            raise OSError(errno.EIO, "the disk is broken")
        return read(file, size)

    monkeypatch.setattr("segway_ecc.deploy.support.bundle.os.read", failing)
    assert _write(tmp_path / "b.zip", _part("log", _stored(log, 3 * 1024 * 1024)), _part("a", "x"))["a"] == "complete"
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        assert "the disk is broken" in json.loads(archive.read(MANIFEST))["parts"][0]["missing"][0]


def test_where_it_cannot_be_written_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file"):
        _write(tmp_path / "nowhere" / "b.zip", _part("a", "x"))

    def interrupted() -> Collected:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _write(tmp_path / "b.zip", {"a": interrupted})
    assert list(tmp_path.iterdir()) == []


def test_an_older_bundle_of_that_name_is_replaced(tmp_path: Path) -> None:
    for text in ("one", "two"):
        _write(tmp_path / "b.zip", _part("a", text))
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        assert archive.read("a.txt") == b"two"


def test_link_stays_a_link_and_its_target_is_written(tmp_path: Path) -> None:
    link = tmp_path / "newest.zip"
    link.symlink_to("b.zip")
    _write(link, _part("a", "x"))
    assert str(link.readlink()) == "b.zip"
    assert zipfile.is_zipfile(tmp_path / "b.zip")


@pytest.mark.parametrize("make", [Path.mkdir, os.mkfifo])
def test_what_is_no_file_is_not_replaced(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / "b.zip")
    before = os.lstat(tmp_path / "b.zip")
    with pytest.raises(FileExistsError, match="there is something other than a file"):
        _write(tmp_path / "b.zip", _part("a", "x"))
    assert os.lstat(tmp_path / "b.zip") == before
    assert len(list(tmp_path.iterdir())) == 1
