# SPDX-License-Identifier: MIT
"""The logs and bundles of robots, fetched into the station's folder by threads of their own.

Piece by piece, checked by size and SHA-256, resumed where it broke off. The station's ROS thread has no part in it, and
what a robot claims decides neither where a file goes nor how much space it takes.
"""

import contextlib
import functools
import os
import shutil
import threading
import urllib.parse
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from segway_ecc.deploy.release.agent.files import sha256_of
from segway_ecc.deploy.support.archive_files import (
    BUNDLE,
    BUSY,
    FAILED,
    LOG,
    LOGS,
    MAKE,
    SHA256,
    FileRequest,
    LogFile,
    Value,
    finished_bundle_of,
    is_sha256,
    logs_of,
    open_log,
    parameter_name,
)
from segway_ecc.node.errors import NobodyListensError

_MOST_KEPT_BYTES: Final = 4 * 1024**3
_LEFT_FREE_BYTES: Final = 256 * 1024**2
_LARGEST_BUNDLE: Final = 512 * 1024**2
_AT_ONCE: Final = 2
_MOST_WAITING: Final = 16
_MOST_REPORTED: Final = 200
_TRIES: Final = 3
_RETRY_S: Final = 0.5
_POLL_S: Final = 0.2
_PATIENCE_S: Final = 180.0
"""For the robot to hash a log, or to make a bundle."""


class FetchError(NobodyListensError):
    """A file could not be fetched; what is here already is kept and resumed from."""


class Archives(Protocol):
    """Reads from the archives of robots; `deploy.support.archive_service.ArchiveCalls` does, over ROS."""

    def ask(self, robot: str, name: str) -> Value:
        """The value of a parameter of the archive in a namespace; waits a few seconds at most.

        Raises:
            NobodyListensError: There is no archive, or it gave no answer.
        """

    def close(self) -> None:
        """Fail what is waited for, and whatever is asked later."""


class _Archive(NamedTuple):
    """The archive of one robot.

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

    def download(self, kind: str, name: str, size: int, part: Path) -> str:
        """Fetch what is not yet in the file `part`; return the SHA-256 of the whole."""
        file = os.open(part, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        with os.fdopen(file, "r+b", buffering=0) as stream:
            here = stream.seek(0, os.SEEK_END)
            self.report(here, size)
            while here < size:
                piece = self.value(parameter_name(FileRequest(kind, name, here)))
                if not isinstance(piece, bytes) or not piece:
                    raise FetchError(f"the robot has no more of {name} at byte {here}: it was deleted or shortened")
                rest = piece[: size - here]
                while rest:
                    rest = rest[os.write(file, rest) :]
                here = stream.tell()
                self.report(here, size)
            os.fsync(file)
        return sha256_of(part)


class Progress(NamedTuple):
    """How far a fetch is: `fetched` of `size` bytes; its `state` is `waiting`, `fetching`, `done` or `failed`."""

    state: str
    fetched: int = 0
    size: int = 0
    why: str = ""

    @property
    def is_going_on(self) -> bool:
        """Whether more is to come."""
        return self.state in {"waiting", "fetching"}


class ArchiveClient:
    """Every method may be called from any thread that may wait; `progress` alone does not wait."""

    def __init__(
        self,
        calls: Archives,
        folder: Path,
        *,
        most_bytes: int = _MOST_KEPT_BYTES,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:
        """Fetch into a folder.

        Args:
            calls: Reads from the robots' archives; ours to close.
            folder: Where fetched logs go, by robot.
            most_bytes: Of fetched logs together; the oldest are deleted.
            free_bytes: Returns the free bytes on the disk of a folder.
        """
        self._calls = calls
        self._folder = folder
        self._most_bytes = most_bytes
        self._free_bytes = free_bytes
        self._pool = ThreadPoolExecutor(_AT_ONCE, "fetch")
        self._progress: dict[tuple[str, str], Progress] = {}
        self._lock = threading.Lock()
        self._space = threading.Lock()
        self._bundle = threading.Lock()
        self._ending = threading.Event()
        for left in folder.glob(".*.part"):  # bundles of a station that was killed
            left.unlink()

    def close(self) -> None:
        """End what goes on; what is here stays for the next time. May be called again."""
        self._ending.set()
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._calls.close()
        self._pool.shutdown()

    def logs(self, robot: str) -> Sequence[LogFile]:
        """The logs that a robot offers, newest first.

        Raises:
            NobodyListensError: It offers none; the text names the command to start.
        """
        answer = self._calls.ask(robot, LOGS)
        if not isinstance(answer, list):
            raise NobodyListensError(
                f"the archive of robot {robot} returns no list of logs; is it a segway-ecc archive?"
            )
        return logs_of(answer)

    def begin(self, robot: str, name: str) -> None:
        """Begin to fetch a log, or go on where a fetch broke off; see `progress`.

        Raises:
            NobodyListensError: Too much is being fetched already.
        """
        key = (robot, name)
        with self._lock:
            going_on = [each for each, progress in self._progress.items() if progress.is_going_on]
            if key in going_on:
                return
            if len(going_on) >= _MOST_WAITING or self._ending.is_set():
                raise NobodyListensError(
                    f"{len(going_on)} logs are being fetched already; try again when they are here"
                )
            over = [each for each in self._progress if each not in going_on]
            for each in over[: max(len(self._progress) - _MOST_REPORTED, 0)]:
                del self._progress[each]
            self._progress[key] = Progress("waiting")
            self._pool.submit(self._fetch, robot, name)

    def progress(self, robot: str) -> Mapping[str, Progress]:
        """How far the logs of a robot are, by name."""
        with self._lock:
            return {name: progress for (each, name), progress in self._progress.items() if each == robot}

    def open(self, robot: str, name: str) -> tuple[int, int]:
        """A fetched log's file descriptor, which is the caller's to close, and its size in bytes.

        Raises:
            FileNotFoundError: It was not fetched.
        """
        return open_log(self._folder_of(robot), name)

    def bundle(self, robot: str) -> Path:
        """A support bundle that the robot made, as a file that is the caller's to remove.

        Raises:
            NobodyListensError: It cannot be fetched.
            OSError: It cannot be written.
        """
        with self._bundle:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            space = min(_LARGEST_BUNDLE, self._free_bytes(self._folder) - _LEFT_FREE_BYTES)
            archive = self._archive(robot, lambda _here, _size: None)
            answer = archive.text_when_done(BUNDLE, MAKE)
            made = finished_bundle_of(answer)
            if made is None:
                raise FetchError(f"the robot made no bundle: {answer.removeprefix(FAILED) or 'it gives no reason'}")
            if made.size > space:
                raise FetchError(f"the robot's bundle has {made.size} bytes, more than the {space} there is room for")
            part = self._folder / f".{made.name}.part"
            part.unlink(missing_ok=True)
            with contextlib.ExitStack() as cleanup:
                cleanup.callback(part.unlink, missing_ok=True)
                if archive.download(BUNDLE, made.name, made.size, part) != made.sha256:
                    raise FetchError("the robot's bundle came damaged; try again")
                cleanup.pop_all()
            return part

    def _fetch(self, robot: str, name: str) -> None:
        key = (robot, name)

        def report(fetched: int, size: int) -> None:
            self._wait(0.0)
            with self._lock:
                self._progress[key] = Progress("fetching", fetched, size)

        try:
            size = self._fetch_log(robot, name, report)
            end = Progress("done", size, size)
        except Exception as error:  # noqa: BLE001 - it is shown as the reason
            known = self._progress[key]
            why = getattr(error, "strerror", None) or str(error) or type(error).__name__
            end = Progress("failed", known.fetched, known.size, why)
        with self._lock:
            self._progress[key] = end

    def _fetch_log(self, robot: str, name: str, report: Callable[[int, int], None]) -> int:
        log = next((log for log in self.logs(robot) if log.name == name), None)
        if log is None:
            raise FetchError(f"the robot has no log {name} any more")
        folder = self._folder_of(robot)
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._make_space(log, folder)
        archive, part, sha256 = self._archive(robot, report), folder / f".{name}.part", ""
        for _ in range(2):
            found = archive.download(LOG, name, log.size, part)
            if not sha256:
                request = parameter_name(FileRequest(SHA256, name, log.size))
                sha256 = archive.text_when_done(request, request)
                if not is_sha256(sha256):
                    raise FetchError(f"the robot has no SHA-256 of {name}: {sha256 or 'it is gone'}")
            if found == sha256:
                os.utime(part, ns=(log.changed_ns, log.changed_ns))
                part.replace(folder / name)
                return log.size
            part.unlink()  # it began with another log of that name: once more from the start
        raise FetchError(f"{name} is not what the robot has, twice; try again")

    def _archive(self, robot: str, report: Callable[[int, int], None]) -> _Archive:
        return _Archive(functools.partial(self._calls.ask, robot), self._wait, report)

    def _wait(self, seconds: float) -> None:
        if self._ending.wait(seconds):
            raise FetchError("the station ends")

    def _folder_of(self, robot: str) -> Path:
        return self._folder / urllib.parse.quote(robot, safe="")

    def _make_space(self, log: LogFile, folder: Path) -> None:
        with self._space:
            if log.size > self._most_bytes:
                raise FetchError(f"{log.name} has {log.size} bytes, more than the {self._most_bytes} that are kept")
            part = folder / f".{log.name}.part"
            kept = [path for path in self._folder.glob("*/*") if path.is_file() and path != part]
            kept.sort(key=lambda path: path.stat().st_mtime_ns, reverse=True)
            total = sum(path.stat().st_size for path in kept)
            while kept and total + log.size > self._most_bytes:
                oldest = kept.pop()
                total -= oldest.stat().st_size
                oldest.unlink()
            if self._free_bytes(self._folder) < log.size + _LEFT_FREE_BYTES:
                raise FetchError(f"the station's disk has no room for {log.name} ({log.size} bytes)")
