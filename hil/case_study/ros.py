# SPDX-License-Identifier: MIT
"""The ROS seat: the model node and sequence control as processes of their own, DDS between them."""

import csv
import os
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.hil.case_study.seats import SeatRun, trajectory
from segway_ecc.hil.case_study.study import Edge, Seat
from segway_ecc.hil.processes import command
from segway_ecc.node.ros.runtime import require_ros
from segway_ecc.node.sequence.manoeuvre import Manoeuvre
from segway_ecc.node.sequence.player import Odometry

_MARGIN_S: Final = 60.0
_FIRST_DOMAIN: Final = 1
_DOMAINS: Final = 100
"""Domains up to 101 are safe on Linux (docs.ros.org, "The ROS_DOMAIN_ID")."""


class RosSeat:
    """Set-points and odometry cross DDS; each run lives in a namespace of its own."""

    seat = Seat.ROS
    jobs = 7

    def __init__(self, folder: Path, logs: Path) -> None:
        """Keep messages in `folder` and logs in `logs`.

        Raises:
            RosUnavailableError: ROS is not there.
        """
        require_ros()
        self._folder = folder
        self._logs = logs
        # A study must not exchange messages with a real robot: it stays on this machine and in a domain of its own.
        self._environment = {
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": str(_FIRST_DOMAIN + os.getpid() % _DOMAINS),
            "ROS_LOG_DIR": str(folder / "ros"),
        }

    def run(self, name: str, manoeuvre: Manoeuvre) -> SeatRun:
        """Play a manoeuvre through ROS; see `SeatRunner.run`."""
        namespace = f"/{name}"
        file, odometry = self._folder / f"ros_{name}.yaml", self._folder / f"ros_{name}.csv"
        file.write_bytes(msgspec.yaml.encode(manoeuvre))
        node = ["run", "cart", "--ros", "--namespace", namespace, "--log", str(self._logs / f"ros_{name}.mcap")]
        sequence = ["sequence", str(file), "--namespace", namespace, "--json", "--csv", str(odometry), "--wait", "60"]
        with (
            command(node, self._folder / f"ros_{name}.node.txt", self._environment),
            command(sequence, self._folder / f"ros_{name}.sequence.txt", self._environment) as player,
        ):
            result = player.result(manoeuvre.duration_ns * 1e-9 + 2 * _MARGIN_S)
        graph = tuple(Edge(**edge) for edge in result["graph"])
        with odometry.open(newline="", encoding="utf-8") as lines:
            rows = csv.reader(lines)
            next(rows)
            points = [Odometry(int(stamp_ns), *map(float, values)) for stamp_ns, *values in rows]
        return SeatRun(trajectory(Seat.ROS, points), graph)
