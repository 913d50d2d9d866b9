"""How much room the logs of a robot take: the oldest is removed first, and never one that is being written."""

import contextlib
import fcntl
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import msgspec

MB: Final = 1_000_000
_SUFFIX: Final = ".mcap"


class Bounds(msgspec.Struct, frozen=True):
    """What logs may take.

    Attributes:
        total_bytes: All of them together.
        file_bytes: One file; then the next begins.
        is_own_folder: Whether every log in the folder is ours to remove; else only the parts of this run are.
    """

    total_bytes: int = 2000 * MB
    file_bytes: int = 256 * MB
    is_own_folder: bool = False


def part(path: Path, number: int) -> Path:
    """The file of the n-th part of a log, from 1 on: `run.mcap`, `run-0002.mcap`, ..."""
    return path if number == 1 else path.with_name(f"{path.stem}-{number:04d}{path.suffix}")


def parts(path: Path) -> list[Path]:
    """The parts of a log that are there, the first one first."""
    later = (found for found in path.parent.glob(f"*{path.suffix}") if _number(path, found) is not None)
    return [path, *sorted(later, key=lambda found: _number(path, found) or 0)]


def make_room(path: Path, bounds: Bounds, taken: int, keep: Path) -> list[Path]:
    """Remove the oldest logs until all of them fit.

    Args:
        path: The first part of the present log.
        bounds: What they may take.
        taken: What the file takes that is being written, bytes.
        keep: That file.

    Returns:
        What was removed.
    """
    there = [found for found in (_logs(path.parent) if bounds.is_own_folder else parts(path)) if found != keep]
    sizes = {found: (status.st_mtime_ns, status.st_size) for found, status in _stats(there)}
    total = taken + sum(size for _, size in sizes.values())
    removed = []
    for found in sorted(sizes, key=lambda found: (sizes[found][0], found.name)):
        if total <= bounds.total_bytes:
            break
        if _remove(found):
            removed.append(found)
            total -= sizes[found][1]
    return removed


def claim(descriptor: int) -> None:
    """Mark a file as being written, until it is closed."""
    with contextlib.suppress(OSError):  # what cannot be locked is no file that would be removed
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _logs(folder: Path) -> list[Path]:
    return list(folder.glob(f"*{_SUFFIX}"))


def _stats(paths: Iterable[Path]) -> Iterator[tuple[Path, os.stat_result]]:
    for path in paths:
        with contextlib.suppress(OSError):  # somebody else has removed it
            yield path, path.stat()


def _number(path: Path, found: Path) -> int | None:
    """Which part of a log a file is; None for the first, and for what is none."""
    stem, _, number = found.stem.rpartition("-")
    is_part = stem == path.stem and number.isascii() and number.isdigit() and found.suffix == path.suffix
    return int(number) if is_part and found == part(path, int(number)) else None


def _remove(path: Path) -> bool:
    """Remove a log unless somebody writes it."""
    try:
        with path.open("rb") as stream:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()
    except OSError:
        return False
    return True
