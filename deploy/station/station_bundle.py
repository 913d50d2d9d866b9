# SPDX-License-Identifier: MIT
"""The support bundle of a robot as the station makes it: the robot's own, and what the station knows of the robot."""

import functools
import os
import tempfile
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Final

import msgspec

from segway_ecc.deploy.station.bundle_part import picture
from segway_ecc.deploy.station.views import FleetStatus
from segway_ecc.deploy.support.bundle import Collected, Part, Stored, write_parts
from segway_ecc.deploy.support.machine_bundle import BundleOptions, machine_parts

_NS_PER_S: Final = 1_000_000_000


class StationBundle:
    """Makes bundles; called with a robot's namespace it returns an open file, which is the caller's to close."""

    def __init__(
        self,
        station: FleetStatus,
        fetch: Callable[[str], Path],
        folder: Path,
        logs: Path,
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """Make bundles of what a station knows.

        Args:
            station: The station.
            fetch: Fetches a robot's own bundle, as a file that is ours to remove.
            folder: The station's folder, with its audit log.
            logs: The station's logs.
            wall_ns: The wall clock, ns since the Unix epoch.
        """
        self._station = station
        self._fetch = fetch
        self._folder = folder
        self._options = BundleOptions(logs, log_count=0, station=folder)
        self._wall_ns = wall_ns

    def __call__(self, robot: str) -> IO[bytes]:
        """The bundle, from its beginning; the file is unlinked already, so closing it removes it."""

        def robots() -> Collected:
            fleet = self._station.fleet()
            mine = [each for each in fleet.robots if each.robot == robot]
            return picture(msgspec.structs.replace(fleet, robots=mine))

        def events() -> Collected:
            mine = [event for event in self._station.events(0) if event.robot in {"", robot}]
            return Collected({"events.jsonl": "".join(msgspec.json.encode(event).decode() + "\n" for event in mine)})

        parts = [
            Part("robot's own bundle", functools.partial(self._own, robot)),
            Part("picture", robots),
            Part("events", events),
            *machine_parts(self._options),
        ]
        made = datetime.fromtimestamp(self._wall_ns() // _NS_PER_S, UTC).isoformat()
        stream = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115 - the caller's to close
        try:
            write_parts(stream, parts, {"robot": robot, "made by": "the base station"}, made)
        except BaseException:
            stream.close()
            raise
        stream.seek(0)
        return stream

    def _own(self, robot: str) -> Collected:
        path = self._fetch(robot)
        try:
            file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        finally:
            path.unlink()
        return Collected({"robot-support.zip": Stored(lambda: file, os.fstat(file).st_size)})
