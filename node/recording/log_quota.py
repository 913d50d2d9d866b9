# SPDX-License-Identifier: MIT
"""How much disk space the logs of a robot take: the oldest is removed first, and never one that is being written."""

import contextlib
import fcntl
import os
from pathlib import Path
from typing import Final

import msgspec

MB: Final = 1_000_000
_SUFFIX: Final = ".mcap"
_FIRST: Final = 1
"""Number of the part that has the log's own name."""


class LogQuota(msgspec.Struct, frozen=True):
    """What logs may take.

    Attributes:
        total_bytes: All of them together.
        file_bytes: One file; then the next begins.
        is_own_folder: Whether every log in the folder is ours to remove; else only the parts of this run are.
    """

    total_bytes: int = 2000 * MB
    file_bytes: int = 256 * MB
    is_own_folder: bool = False


def part_path(path: Path, number: int) -> Path:
    """The file of the n-th part of a log, from 1 on: `run.mcap`, `run-0002.mcap`, ..."""
    return path if number == _FIRST else path.with_name(f"{path.stem}-{number:04d}{path.suffix}")


def part_paths(path: Path) -> list[Path]:
    """The parts of a log that are there, the first one first."""
    numbers = [_number(path, entry.name) for entry in _entries(path.parent)]
    return [path, *(part_path(path, number) for number in sorted(n for n in numbers if n is not None))]


def following_parts(path: Path) -> list[Path]:
    """The parts behind one that is not the first of its log, which may be gone."""
    stem = path.stem.rpartition("-")[0]
    parts = part_paths(path.with_name(stem + path.suffix)) if stem else []
    return parts[parts.index(path) + 1 :] if path in parts[1:] else []


def remove_oldest_logs(path: Path, quota: LogQuota, taken: int, keep: Path) -> list[Path]:
    """Remove the oldest logs until all of them fit; returns what was removed.

    Args:
        path: The first part of the present log.
        quota: What they may take.
        taken: What the file takes that is being written, bytes.
        keep: That file.
    """
    # By their names: each Path made of one would take a place among Python's interned strings, and their table grow.
    others = []
    for entry in _entries(path.parent):
        is_part = entry.name == path.name or _number(path, entry.name) is not None
        if (entry.name.endswith(_SUFFIX) if quota.is_own_folder else is_part) and entry.name != keep.name:
            with contextlib.suppress(OSError):  # somebody else has removed it
                status = entry.stat()
                others.append((status.st_mtime_ns, entry.name, status.st_size))
    total = taken + sum(size for _, _, size in others)
    removed = []
    for _, name, size in sorted(others):
        if total <= quota.total_bytes:
            break
        found = path.with_name(name)
        # Not one that somebody writes, or has removed.
        with contextlib.suppress(OSError), found.open("rb") as stream:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            found.unlink()
            removed.append(found)
            total -= size
    return removed


def lock_log(descriptor: int) -> None:
    """Mark a file as being written, until it is closed."""
    with contextlib.suppress(OSError):  # what cannot be locked is no file that would be removed
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _entries(folder: Path) -> list[os.DirEntry[str]]:
    """What is in a folder; nothing where it is not there."""
    try:
        with os.scandir(folder) as found:
            return list(found)
    except OSError:
        return []


def _number(path: Path, name: str) -> int | None:
    """Which part of a log a file is; None for the first, and for what is none."""
    head, tail = f"{path.stem}-", path.suffix
    number = name.removeprefix(head).removesuffix(tail)
    is_part = number.isascii() and number.isdigit() and name == f"{head}{int(number):04d}{tail}"
    return int(number) if is_part and int(number) != _FIRST else None
