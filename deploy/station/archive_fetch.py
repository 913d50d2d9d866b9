"""Fetches a file from a robot's archive, piece by piece: checked by size and SHA-256, resumed where it broke off."""

import contextlib
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from segway_ecc.deploy.support.log_folder import LogFile
from segway_ecc.deploy.support.pieces import (
    BUNDLE,
    BUSY,
    FAILED,
    LOG,
    MAKE,
    SHA256,
    FileRequest,
    FinishedBundle,
    Value,
    finished_bundle_of,
    is_sha256,
    parameter_name,
)
from segway_ecc.node.errors import NobodyListensError

_TRIES: Final = 3
_RETRY_S: Final = 0.5
_LOOK_S: Final = 0.2
_PATIENCE_S: Final = 180.0
"""For the robot to hash a log, or to make a bundle."""
_HASHED_AT_ONCE: Final = 1024 * 1024


class FetchError(NobodyListensError):
    """A file could not be fetched; what is here already is kept and resumed from."""


class ArchiveConnection(NamedTuple):
    """A line to the archive of one robot.

    Attributes:
        ask: What the value of a parameter is.
        wait: Waits for some seconds, or raises FetchError where all is to end.
        tell: Called with how many bytes are here, and how many there are.
    """

    ask: Callable[[str], Value]
    wait: Callable[[float], None]
    tell: Callable[[int, int], None]


def fetch_log(line: ArchiveConnection, log: LogFile, folder: Path) -> Path:
    """Fetch a log into a folder; return where it is, whole and checked.

    Raises:
        NobodyListensError: It cannot be had; what is here of it stays, for the next time.
        OSError: It cannot be written.
    """
    part, target = folder / f".{log.name}.part", folder / log.name
    sha256 = ""
    for _ in range(2):
        _download(line, LOG, log.name, log.size, part)
        sha256 = sha256 or _sha256(line, log)
        if _hashed(part) == sha256:
            os.utime(part, ns=(log.changed_ns, log.changed_ns))
            part.replace(target)
            return target
        part.unlink()  # it began with another log of that name: once more from the start
    raise FetchError(f"{log.name} is not what the robot has, twice; try again")


def fetch_bundle(line: ArchiveConnection, folder: Path, most_bytes: int) -> Path:
    """Have the robot make a support bundle, and fetch it.

    Raises:
        NobodyListensError: It cannot be had.
        OSError: It cannot be written.
    """
    made = _made(line)
    if made.size > most_bytes:
        raise FetchError(f"the robot's bundle has {made.size} bytes, more than the {most_bytes} that there is room for")
    part = folder / f".{made.name}.part"
    with contextlib.suppress(FileNotFoundError):
        part.unlink()
    try:
        _download(line, BUNDLE, made.name, made.size, part)
        _require(part, made)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return part


def _require(part: Path, made: FinishedBundle) -> None:
    if _hashed(part) != made.sha256:
        raise FetchError("the robot's bundle came damaged; try again")


def _download(line: ArchiveConnection, kind: str, name: str, size: int, part: Path) -> None:
    file = os.open(part, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        here = os.fstat(file).st_size
        line.tell(here, size)
        while here < size:
            piece = _piece(line, FileRequest(kind, name, here))[: size - here]
            _write(file, piece, here)
            here += len(piece)
            line.tell(here, size)
        os.fsync(file)
    finally:
        os.close(file)


def _write(file: int, piece: bytes, at: int) -> None:
    while piece:
        count = os.pwrite(file, piece, at)
        piece, at = piece[count:], at + count


def _piece(line: ArchiveConnection, wanted: FileRequest) -> bytes:
    answer = _asked(line, parameter_name(wanted))
    if not isinstance(answer, bytes) or not answer:
        raise FetchError(f"the robot has no more of {wanted.name} at byte {wanted.number}: it is gone, or was cut")
    return answer


def _sha256(line: ArchiveConnection, log: LogFile) -> str:
    answer = _when_done(line, parameter_name(FileRequest(SHA256, log.name, log.size)), "")
    if not is_sha256(answer):
        raise FetchError(f"the robot cannot tell the SHA-256 of {log.name}: {answer or 'it is gone'}")
    return answer


def _made(line: ArchiveConnection) -> FinishedBundle:
    answer = _when_done(line, BUNDLE, MAKE)
    made = finished_bundle_of(answer)
    if made is None:
        raise FetchError(f"the robot made no bundle: {answer.removeprefix(FAILED) or 'it says nothing'}")
    return made


def _when_done(line: ArchiveConnection, name: str, begin: str) -> str:
    """An answer, once it is no longer `busy`."""
    answer = _asked(line, begin or name)
    for _ in range(round(_PATIENCE_S / _LOOK_S)):
        if answer != BUSY:
            return answer if isinstance(answer, str) else ""
        line.wait(_LOOK_S)
        answer = _asked(line, name)
    raise FetchError(f"the robot was not done within {_PATIENCE_S:g} s")


def _asked(line: ArchiveConnection, name: str) -> Value:
    """An answer; a question or an answer that is lost is asked again."""
    for _ in range(_TRIES - 1):
        try:
            return line.ask(name)
        except NobodyListensError:
            line.wait(_RETRY_S)
    return line.ask(name)


def _hashed(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while piece := stream.read(_HASHED_AT_ONCE):
            digest.update(piece)
    return digest.hexdigest()
