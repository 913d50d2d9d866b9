# SPDX-License-Identifier: MIT
"""The logs of robots, fetched into the station's folder by threads of their own.

The station's ROS thread has no part in it, and what a robot claims decides neither where a file goes nor how much
space it takes.
"""

import functools
import shutil
import threading
import urllib.parse
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from segway_ecc.deploy.station.archive_fetch import ArchiveConnection, FetchError, fetch_bundle, fetch_log
from segway_ecc.deploy.support.log_folder import LogFile, open_log
from segway_ecc.deploy.support.pieces import LOGS, Value, logs_of
from segway_ecc.node.errors import NobodyListensError

MOST_KEPT_BYTES: Final = 4 * 1024**3
_LEFT_FREE_BYTES: Final = 256 * 1024**2
_LARGEST_BUNDLE: Final = 512 * 1024**2
_AT_ONCE: Final = 2
_MOST_WAITING: Final = 16
_MOST_REPORTED: Final = 200


class ParameterReader(Protocol):
    """Reads from archives; `segway_ecc.deploy.support.archive_calls.ArchiveCalls` is one."""

    def ask(self, robot: str, name: str) -> Value:
        """The value of a parameter of a robot's archive."""

    def close(self) -> None:
        """End it; later calls of `ask` fail."""


class Progress(NamedTuple):
    """How far a fetch is.

    Attributes:
        state: `waiting`, `fetching`, `done` or `failed`.
        fetched: Bytes that are here.
        size: Bytes that there are.
        why: Why it failed.
    """

    state: str
    fetched: int = 0
    size: int = 0
    why: str = ""

    @property
    def is_going_on(self) -> bool:
        """Whether more is to come."""
        return self.state in {"waiting", "fetching"}


class ArchiveClient:
    """Every method may be called from any thread that may wait."""

    def __init__(
        self,
        calls: ParameterReader,
        folder: Path,
        *,
        most_bytes: int = MOST_KEPT_BYTES,
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
        """End what goes on; what is here stays for the next time."""
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
            return fetch_bundle(self._connection(robot, lambda _here, _size: None), self._folder, space)

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
        fetch_log(self._connection(robot, report), log, folder)
        return log.size

    def _connection(self, robot: str, report: Callable[[int, int], None]) -> ArchiveConnection:
        return ArchiveConnection(functools.partial(self._calls.ask, robot), self._wait, report)

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
