# SPDX-License-Identifier: MIT
import errno
import json
import logging
import os
import threading
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.deploy.station.web.audit import AuditEntry, AuditLog


def lines(folder: Path, name: str = "audit.jsonl") -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / name).read_text().splitlines()]


def test_entries_stand_in_their_order_with_their_time(tmp_path: Path) -> None:
    audit = AuditLog(tmp_path, lambda: 1_600_000_000_123_456_789)
    audit.add(
        AuditEntry(who="ann", role="operator", address="192.0.2.1", act="arm", robot="/a", number=3, outcome="asked")
    )
    audit.add(AuditEntry(outcome="done", act="ends", text="x" * 1000))
    audit.close()
    first, second = lines(tmp_path)
    assert first == {
        "time": "2020-09-13T12:26:40.123456Z",
        "who": "ann",
        "role": "operator",
        "address": "192.0.2.1",
        "act": "arm",
        "robot": "/a",
        "number": 3,
        "outcome": "asked",
    }
    assert len(second["text"]) == 500
    assert (tmp_path / "audit.jsonl").stat().st_mode & 0o777 == 0o600


def test_a_new_station_appends(tmp_path: Path) -> None:
    for act in ("one", "two"):
        audit = AuditLog(tmp_path, lambda: 0)
        audit.add(AuditEntry(act=act, outcome="done"))
        audit.close()
    assert [line["act"] for line in lines(tmp_path)] == ["one", "two"]


def test_a_text_cannot_forge_a_line(tmp_path: Path) -> None:
    audit = AuditLog(tmp_path, lambda: 0)
    audit.add(AuditEntry(outcome="done", act="login", text='"}\n{"who": "ann", "act": "arm"}'))
    audit.close()
    assert [line["act"] for line in lines(tmp_path)] == ["login"]


def test_it_is_bounded_and_the_newest_stay(tmp_path: Path) -> None:
    audit = AuditLog(tmp_path, lambda: 0, most_bytes=1000, kept=2)
    for number in range(200):
        audit.add(AuditEntry(outcome="done", act="arm", number=number + 1))
    audit.close()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["audit.1.jsonl", "audit.2.jsonl", "audit.jsonl"]
    assert all(path.stat().st_size <= 1000 for path in tmp_path.iterdir())
    kept = [line["number"] for name in (names[1], names[0], names[2]) for line in lines(tmp_path, name)]
    assert kept == list(range(201 - len(kept), 201))
    assert len(kept) > 20


def test_full_disk_is_logged_once_and_stops_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    is_full = True

    def write(file: int, content: bytes) -> int:
        if is_full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return os.write(file, content)

    audit = AuditLog(tmp_path, lambda: 0, write=write)
    with caplog.at_level(logging.ERROR):
        for _ in range(5):
            audit.add(AuditEntry(outcome="done", act="lost"))
        _wait(audit, 5)
        is_full = False
        audit.add(AuditEntry(outcome="done", act="kept"))
        audit.close()
    assert [line["act"] for line in lines(tmp_path)] == ["kept"]
    (output,) = [record.getMessage() for record in caplog.records]
    assert output.startswith(f"the audit log {tmp_path / 'audit.jsonl'} cannot be written: No space left on device;")


def test_torn_line_leaves_others_valid(tmp_path: Path) -> None:
    room = [10]

    def write(file: int, content: bytes) -> int:
        return os.write(file, content[: room.pop()] if room else content)

    audit = AuditLog(tmp_path, lambda: 0, write=write)
    audit.add(AuditEntry(outcome="done", act="torn"))
    audit.add(AuditEntry(outcome="done", act="whole"))
    audit.close()
    torn, whole = (tmp_path / "audit.jsonl").read_text().splitlines()
    assert len(torn) == 10
    assert json.loads(whole)["act"] == "whole"
    assert audit.lost == 1


def test_hanging_disk_does_not_block(tmp_path: Path) -> None:
    hangs = threading.Event()
    audit = AuditLog(tmp_path, lambda: 0, write=lambda _, content: len(content) if hangs.wait(30.0) else 0)
    for _ in range(10_100):
        audit.add(AuditEntry(outcome="done", act="arm"))
    assert 90 <= audit.lost <= 100
    hangs.set()
    audit.close()


def test_audit_log_does_not_follow_symlink(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").touch()
    (tmp_path / "audit.jsonl").symlink_to(tmp_path / "elsewhere")
    audit = AuditLog(tmp_path, lambda: 0)
    audit.add(AuditEntry(outcome="done", act="arm"))
    audit.close()
    assert audit.lost == 1
    assert (tmp_path / "elsewhere").read_text() == ""


def _wait(audit: AuditLog, lost: int) -> None:
    for _ in range(1000):
        if audit.lost == lost:
            return
        threading.Event().wait(0.01)
    raise AssertionError(audit.lost)
