# SPDX-License-Identifier: MIT
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
    Value,
    finished_bundle_of,
    is_sha256,
    parameter_name,
)
from segway_ecc.node.errors import NobodyListensError

_TRIES: Final = 3
_RETRY_S: Final = 0.5
_POLL_S: Final = 0.2
_PATIENCE_S: Final = 180.0
"""For the robot to hash a log, or to make a bundle."""


class FetchError(NobodyListensError):
    """A file could not be fetched; what is here already is kept and resumed from."""


class ArchiveConnection(NamedTuple):
    """Access to the archive of one robot.

    Attributes:
        ask: Returns the value of a parameter.
        wait: Waits for some seconds, or raises FetchError where all is to end.
        report: Called with how many bytes are here, and how many there are.
    """

    ask: Callable[[str], Value]
    wait: Callable[[float], None]
    report: Callable[[int, int], None]

    def value(self, name: str) -> Value:
        """The value of a parameter; a request or an answer that is lost is repeated."""
        for _ in range(_TRIES - 1):
            try:
                return self.ask(name)
            except NobodyListensError:
                self.wait(_RETRY_S)
        return self.ask(name)

    def text_when_done(self, name: str, begin: str) -> str:
        """The text of `begin`, or of `name` once it is no longer `busy`; empty where it is no text."""
        answer = self.value(begin)
        for _ in range(round(_PATIENCE_S / _POLL_S)):
            if answer != BUSY:
                return answer if isinstance(answer, str) else ""
            self.wait(_POLL_S)
            answer = self.value(name)
        raise FetchError(f"the robot was not done within {_PATIENCE_S:g} s")


def fetch_log(connection: ArchiveConnection, log: LogFile, folder: Path) -> Path:
    """Fetch a log into a folder; return where it is, whole and checked.

    Raises:
        NobodyListensError: It cannot be fetched; what is here of it stays, for the next time.
        OSError: It cannot be written.
    """
    part, target = folder / f".{log.name}.part", folder / log.name
    sha256 = ""
    for _ in range(2):
        _download(connection, LOG, log.name, log.size, part)
        if not sha256:
            name = parameter_name(FileRequest(SHA256, log.name, log.size))
            sha256 = connection.text_when_done(name, name)
            if not is_sha256(sha256):
                raise FetchError(f"the robot has no SHA-256 of {log.name}: {sha256 or 'it is gone'}")
        if _hashed(part) == sha256:
            os.utime(part, ns=(log.changed_ns, log.changed_ns))
            part.replace(target)
            return target
        part.unlink()  # it began with another log of that name: once more from the start
    raise FetchError(f"{log.name} is not what the robot has, twice; try again")


def fetch_bundle(connection: ArchiveConnection, folder: Path, most_bytes: int) -> Path:
    """Have the robot make a support bundle, and fetch it.

    Raises:
        NobodyListensError: It cannot be fetched.
        OSError: It cannot be written.
    """
    answer = connection.text_when_done(BUNDLE, MAKE)
    made = finished_bundle_of(answer)
    if made is None:
        raise FetchError(f"the robot made no bundle: {answer.removeprefix(FAILED) or 'it gives no reason'}")
    if made.size > most_bytes:
        raise FetchError(f"the robot's bundle has {made.size} bytes, more than the {most_bytes} that there is room for")
    part = folder / f".{made.name}.part"
    part.unlink(missing_ok=True)
    with contextlib.ExitStack() as cleanup:
        cleanup.callback(part.unlink, missing_ok=True)
        _download(connection, BUNDLE, made.name, made.size, part)
        if _hashed(part) != made.sha256:
            raise FetchError("the robot's bundle came damaged; try again")
        cleanup.pop_all()
    return part


def _download(connection: ArchiveConnection, kind: str, name: str, size: int, part: Path) -> None:
    file = os.open(part, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    with os.fdopen(file, "r+b", buffering=0) as stream:
        here = stream.seek(0, os.SEEK_END)
        connection.report(here, size)
        while here < size:
            piece = connection.value(parameter_name(FileRequest(kind, name, here)))
            if not isinstance(piece, bytes) or not piece:
                raise FetchError(f"the robot has no more of {name} at byte {here}: it was deleted or shortened")
            rest = piece[: size - here]
            while rest:
                rest = rest[os.write(file, rest) :]
            here = stream.tell()
            connection.report(here, size)
        os.fsync(file)


def _hashed(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
