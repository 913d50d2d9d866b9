# SPDX-License-Identifier: MIT
"""The logs of robots: listed, fetched into the station's folder, and then downloaded from there."""

import asyncio
import contextlib
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from segway_ecc.deploy.station.views import FleetView
from segway_ecc.deploy.station.web.interfaces import Archive
from segway_ecc.deploy.station.web.log_pages import RobotLogs
from segway_ecc.deploy.support.log_folder import LogFile
from segway_ecc.node.errors import NodeError

_AT_ONCE: Final = 8
_MOST_LISTED: Final = 20
_FRESH_NS: Final = 2_000_000_000


class RobotArchives:
    """Lists the logs of robots, each at most once at a time and every two seconds, however many browsers ask."""

    def __init__(self, archive: Archive, clock_ns: Callable[[], int]) -> None:
        """List by an archive."""
        self._archive = archive
        self._clock_ns = clock_ns
        # Of its own: what waits for robots must not delay what reads files.
        self._pool = ThreadPoolExecutor(_AT_ONCE, "robot-logs")
        self._asking: dict[str, asyncio.Task[RobotLogs]] = {}
        self._asked: dict[str, tuple[int, RobotLogs]] = {}

    async def of_all(self, fleet: FleetView) -> Sequence[RobotLogs]:
        """The logs of every living robot."""
        names = [robot.robot for robot in fleet.robots if robot.is_alive][:_MOST_LISTED]
        return await asyncio.gather(*(self.of(name) for name in names))

    async def of(self, robot: str) -> RobotLogs:
        """The logs of one robot."""
        asked = self._asked.get(robot)
        if asked is None or self._clock_ns() - asked[0] > _FRESH_NS:
            task = self._asking.get(robot)
            if task is None:
                task = self._asking[robot] = asyncio.create_task(self._ask(robot))
            await asyncio.shield(task)
            asked = self._asked[robot]
        logs = asked[1]
        here = await asyncio.to_thread(_here, self._archive, robot, [log.name for log in logs.logs])
        return logs._replace(progress=self._archive.progress(robot), here=here)

    async def begin(self, robot: str, name: str) -> str:
        """Begin to fetch a log; return why it cannot be fetched, or an empty text."""
        try:
            await asyncio.to_thread(self._archive.begin, robot, name)
        except NodeError as error:
            return str(error)
        return ""

    async def open(self, robot: str, name: str) -> tuple[int, int]:
        """A log that was fetched: its descriptor, which is the caller's to close, and its size.

        Raises:
            FileNotFoundError: It was not fetched.
        """
        return await asyncio.to_thread(self._archive.open, robot, name)

    async def _ask(self, robot: str) -> RobotLogs:
        try:
            logs = await asyncio.get_running_loop().run_in_executor(self._pool, self._archive.logs, robot)
            found = RobotLogs(robot, logs)
        except NodeError as error:
            found = RobotLogs(robot, error=str(error))
        finally:
            del self._asking[robot]
        self._asked[robot] = (self._clock_ns(), found)
        return found


def _here(archive: Archive, robot: str, names: Iterable[str]) -> Mapping[str, LogFile]:
    found = {}
    for name in names:
        with contextlib.suppress(FileNotFoundError):
            file, size = archive.open(robot, name)
            changed_ns = os.fstat(file).st_mtime_ns
            os.close(file)
            found[name] = LogFile(name, size, changed_ns)
    return found
