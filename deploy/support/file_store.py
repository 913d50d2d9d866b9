# SPDX-License-Identifier: MIT
"""What a robot hands out, by the names of `segway_ecc.deploy.support.archive_files`; knows no ROS."""

import contextlib
import functools
import hashlib
import os
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Final, TypeAlias

from segway_ecc.deploy.support.archive_files import (
    BUNDLE,
    BUSY,
    FAILED,
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
    logs_in,
    open_log,
)

_LOWEST: Final = 19
_ENDS_WITHIN_S: Final = 10.0
_KEPT: Final = 256
_HASHED_AT_ONCE: Final = 1024 * 1024
_FRESH_NS: Final = 30_000_000_000
MakeBundle: TypeAlias = Callable[[Path], Path]
"""Makes a support bundle in a folder and returns its path; may take a minute."""


class Worker:
    """Runs tasks, each known by a key, and keeps their results; `key` is that of the last. Used by one thread."""

    def __init__(self) -> None:
        self.key = ""
        self._results: OrderedDict[str, str] = OrderedDict()
        self._thread: threading.Thread | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a task runs."""
        return self._thread is not None and self._thread.is_alive()

    def result(self, key: str) -> str | None:
        """The result of a task; None where there is none yet."""
        return self._results.get(key)

    def forget(self, key: str) -> None:
        """Discard a result, so that its task can run again."""
        self._results.pop(key, None)

    def begin(self, key: str, task: Callable[[], str]) -> bool:
        """Run a task in place of its last result; whether it was begun, which it is not while another runs."""
        if self.is_busy:
            return False
        self.forget(key)
        self.key = key

        def run() -> None:
            with contextlib.suppress(OSError):
                # On Linux a priority is of one thread (setpriority(2), NOTES).
                os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LOWEST)
            try:
                result = task()
            except Exception as error:  # noqa: BLE001 - whoever asks gets it as the result
                result = f"failed: {getattr(error, 'strerror', None) or error or type(error).__name__}"
            self._results[key] = result
            while len(self._results) > _KEPT:
                self._results.popitem(last=False)

        self._thread = threading.Thread(target=run, name="archive", daemon=True)
        self._thread.start()
        return True

    def close(self) -> None:
        """Wait a moment for the task that runs."""
        if self._thread is not None:
            self._thread.join(_ENDS_WITHIN_S)


class FileStore:
    """The logs of a folder and the newest support bundle, as parameters."""

    def __init__(
        self,
        logs: Path,
        work: Path,
        make: MakeBundle,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        *,
        robots: Collection[str] | None = None,
    ) -> None:
        """Hand out the logs of one folder, and from another, which is ours, the newest bundle that was made.

        `robots` are the names of those whose logs are handed out, or None for any.
        """
        self._logs = logs
        self._work = work
        self._make = make
        self._robots = robots
        self._clock_ns = clock_ns
        self._worker = Worker()
        self._is_wanted = False
        self._made_ns = 0

    def answer(self, name: str) -> Value:
        """The value of a parameter; None where there is no such thing."""
        if name == LOGS:
            return listing_of(logs_in(self._logs, self._robots))
        if name in {BUNDLE, MAKE}:
            return self._bundle(is_wanted=name == MAKE)
        request = file_request_of(name)
        return None if request is None else self._content(request)

    def close(self) -> None:
        """Wait a moment for what is being made."""
        self._worker.close()

    def _content(self, request: FileRequest) -> Value:
        last = self._last_made()
        if request.kind == BUNDLE and (last is None or last.name != request.name):
            return None
        try:
            if request.kind == BUNDLE:
                file, size = open_log(self._work, request.name)
            else:
                file, size = open_log(self._logs, request.name, self._robots)
        except FileNotFoundError:
            return None
        try:
            if request.kind != SHA256:
                return os.pread(file, PIECE_BYTES, request.number)
            # A log only grows: its beginning stays what it was.
            key = f"{SHA256} {request.name} {request.number} {os.fstat(file).st_ino}"
            return self._sha256(key, request) if size >= request.number else None
        except OSError:
            return None
        finally:
            os.close(file)

    def _sha256(self, key: str, request: FileRequest) -> str:
        result = self._worker.result(key)
        if result is None:
            self._worker.begin(key, functools.partial(_hashed, self._logs, request.name, request.number))
            return BUSY
        if result.startswith(FAILED):
            self._worker.forget(key)
        return result

    def _bundle(self, *, is_wanted: bool) -> str:
        if self._worker.is_busy and self._worker.key == BUNDLE:
            return BUSY
        old = self._last_made()
        # Another one, made a moment after the last, would take that from who fetches it.
        if is_wanted and (old is None or self._clock_ns() - self._made_ns >= _FRESH_NS):
            self._is_wanted = True
        if not self._is_wanted:
            return self._worker.result(BUNDLE) or NONE

        def make() -> str:
            path = self._make(self._work)
            size = path.stat().st_size
            self._made_ns = self._clock_ns()
            return f"{path.name} {size} {_hashed(self._work, path.name, size)}"

        if self._worker.begin(BUNDLE, make):  # or else a log is being hashed: next time
            self._is_wanted = False
            if old is not None:
                (self._work / old.name).unlink(missing_ok=True)
        return BUSY

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
