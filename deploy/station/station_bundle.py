# SPDX-License-Identifier: MIT
"""Support bundles: what the station adds to a robot's own, and the part on the robots of the ROS network."""

import functools
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import IO, Final

import msgspec

from segway_ecc.deploy.station.ros_bridge import ros_network
from segway_ecc.deploy.station.station import Station
from segway_ecc.deploy.station.views import FleetStatus
from segway_ecc.deploy.support.bundle import Collected, Parts, Stored, json_text, write_parts
from segway_ecc.deploy.support.machine_bundle import BundleOptions, machine_parts
from segway_ecc.node.ros.runtime import discovery_text, require_ros

_POLL_S: Final = 0.05


@dataclass(frozen=True)
class StationBundle:
    """Makes bundles; called with a robot's namespace it returns an open file, which is the caller's to close.

    Attributes:
        station: What is known of the robots.
        fetch: Fetches a robot's own bundle, as a file that is ours to remove.
        folder: The station's folder, with its audit log.
        logs: The station's logs.
        wall_ns: The wall clock, ns since the Unix epoch.
    """

    station: FleetStatus
    fetch: Callable[[str], Path]
    folder: Path
    logs: Path
    wall_ns: Callable[[], int] = time.time_ns

    def __call__(self, robot: str) -> IO[bytes]:
        """The bundle, from its beginning; the file is unlinked already, so closing it removes it."""

        def robots() -> Collected:
            fleet = self.station.fleet()
            mine = [each for each in fleet.robots if each.robot == robot]
            return Collected({"robots.json": json_text(msgspec.structs.replace(fleet, robots=mine))})

        def events() -> Collected:
            mine = [event for event in self.station.events(0) if event.robot in {"", robot}]
            return Collected({"events.jsonl": "".join(msgspec.json.encode(event).decode() + "\n" for event in mine)})

        parts: Parts = {
            "robot's own bundle": functools.partial(self._own, robot),
            "picture": robots,
            "events": events,
            **machine_parts(BundleOptions(self.logs, log_count=0, station=self.folder)),
        }
        made = datetime.fromtimestamp(self.wall_ns() // 1_000_000_000, UTC).isoformat()
        stream = tempfile.TemporaryFile(dir=self.folder)  # noqa: SIM115 - the caller's to close
        try:
            write_parts(stream, parts, {"robot": robot, "made by": "the base station"}, made)
        except BaseException:
            stream.close()
            raise
        stream.seek(0)
        return stream

    def _own(self, robot: str) -> Collected:
        path = self.fetch(robot)
        try:
            file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        finally:
            path.unlink()
        return Collected({"robot-support.zip": Stored(lambda: file, os.fstat(file).st_size)})


def robots(ros_arguments: Sequence[str] = (), patience_s: float = 5.0) -> Collected:
    """A picture of every robot that is found, as `segway-ecc station status --json` shows it.

    All reports are waited for `patience_s`, s; `ros_arguments` begin with `--ros-args`, as on the command line.
    """
    require_ros()
    deadline_s = time.monotonic() + patience_s
    with Station("support", partial(ros_network, ros_arguments), is_watching=True) as station:
        fleet = station.fleet()
        while time.monotonic() < deadline_s and not fleet.is_settled:
            time.sleep(_POLL_S)
            fleet = station.fleet()
    if not fleet.robots:
        return Collected({}, [f"no robot was found within {patience_s:g} s ({discovery_text()})"])
    return Collected({"robots.json": json_text(fleet)})
