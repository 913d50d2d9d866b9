"""What a robot hands out, by the names of `segway_ecc.deploy.support.pieces`; knows no ROS."""

import functools
import hashlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeAlias

from segway_ecc.deploy.support.log_folder import logs_in, open_log
from segway_ecc.deploy.support.pieces import (
    BUNDLE,
    BUSY,
    FAILED,
    LOG,
    LOGS,
    MAKE,
    NONE,
    PIECE_BYTES,
    SHA256,
    FileRequest,
    FinishedBundle,
    Value,
    file_request_of,
    finished_bundle_of,
    listing_of,
)
from segway_ecc.deploy.support.worker import Worker

_HASHED_AT_ONCE: Final = 1024 * 1024
_FRESH_NS: Final = 30_000_000_000
MakeBundle: TypeAlias = Callable[[Path], Path]
"""Makes a support bundle in a folder, and tells where; may take a minute."""


class FileStore:
    """Answers what is asked for."""

    def __init__(
        self, logs: Path, work: Path, make: MakeBundle, clock_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        """Hand out the logs of a folder, and bundles.

        Args:
            logs: The logs.
            work: A folder of ours, for the newest bundle.
            make: Makes a bundle.
            clock_ns: The monotonic clock, ns.
        """
        self._logs = logs
        self._work = work
        self._make = make
        self._clock_ns = clock_ns
        self._worker = Worker()
        self._is_wanted = False
        self._made_ns = 0

    def answer(self, name: str) -> Value:
        """The value of a parameter; None where there is no such thing."""
        if name == LOGS:
            return listing_of(logs_in(self._logs))
        if name in {BUNDLE, MAKE}:
            return self._bundle(is_wanted=name == MAKE)
        wanted = file_request_of(name)
        if wanted is None:
            return None
        if wanted.kind == SHA256:
            return self._sha256(wanted)
        return self._piece(wanted)

    def close(self) -> None:
        """Wait a moment for what is being made."""
        self._worker.close()

    def _piece(self, wanted: FileRequest) -> bytes | None:
        folder = self._logs if wanted.kind == LOG else self._work
        made = self._last_made()
        if wanted.kind == BUNDLE and (made is None or made.name != wanted.name):
            return None
        try:
            file, _ = open_log(folder, wanted.name)
        except FileNotFoundError:
            return None
        try:
            return os.pread(file, PIECE_BYTES, wanted.number)
        except OSError:
            return None
        finally:
            os.close(file)

    def _sha256(self, wanted: FileRequest) -> str | None:
        try:
            file, size = open_log(self._logs, wanted.name)
        except FileNotFoundError:
            return None
        # A log only grows: its beginning stays what it was.
        key = f"{SHA256} {wanted.name} {wanted.number} {os.fstat(file).st_ino}"
        os.close(file)
        if size < wanted.number:
            return None
        result = self._worker.result(key)
        if result is None:
            self._worker.begin(key, functools.partial(_hashed, self._logs, wanted.name, wanted.number))
            return BUSY
        if result.startswith(FAILED):
            self._worker.forget(key)
        return result

    def _bundle(self, *, is_wanted: bool) -> str:
        if self._worker.is_busy and self._worker.key == BUNDLE:
            return BUSY
        if is_wanted and not self._is_fresh():
            self._is_wanted = True
        if not self._is_wanted:
            return self._worker.result(BUNDLE) or NONE
        old = self._last_made()
        if self._worker.begin(BUNDLE, self._made):  # or else a log is being hashed: next time
            self._is_wanted = False
            if old is not None:
                (self._work / old.name).unlink(missing_ok=True)
        return BUSY

    def _is_fresh(self) -> bool:
        """Whether the newest bundle was made a moment ago; another one would take it from who fetches it."""
        return self._last_made() is not None and self._clock_ns() - self._made_ns < _FRESH_NS

    def _made(self) -> str:
        path = self._make(self._work)
        size = path.stat().st_size
        self._made_ns = self._clock_ns()
        return f"{path.name} {size} {_hashed(self._work, path.name, size)}"

    def _last_made(self) -> FinishedBundle | None:
        result = self._worker.result(BUNDLE)
        return None if result is None else finished_bundle_of(result)


def _hashed(folder: Path, name: str, size: int) -> str:
    """The SHA-256 of the first bytes of a file, or what failed."""
    try:
        file, _ = open_log(folder, name)
    except FileNotFoundError:
        return f"{FAILED}it is not there any more"
    digest, left = hashlib.sha256(), size
    try:
        while left > 0 and (piece := os.read(file, min(left, _HASHED_AT_ONCE))):
            digest.update(piece)
            left -= len(piece)
    finally:
        os.close(file)
    return digest.hexdigest() if left == 0 else f"{FAILED}it has become shorter"
