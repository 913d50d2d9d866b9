# SPDX-License-Identifier: MIT
"""What a station needs of the network that its robots are on: ROS, or a simulation in the same process."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Protocol, TypeAlias

from segway_ecc.deploy.station.command_handler import CommandHandler
from segway_ecc.deploy.station.fleet import EventLog, Heartbeats


class RobotNetwork(Protocol):
    """Belongs to the station's thread; nothing of it but `flush` waits."""

    @property
    def is_waiting(self) -> bool:
        """Whether a report or a response of some robot is awaited."""

    def poll(self, *, everything: bool) -> None:
        """Pass on everything that has arrived; or only responses and modes of the robots that are waited for."""

    def beat(self, now_ns: int) -> None:
        """Send a heartbeat to every robot, where one is due."""

    def discover(self, now_ns: int) -> None:
        """Look for robots that have come and gone."""

    def refused(self) -> Mapping[str, int]:
        """Messages of robots that were not valid, by cause."""

    def flush(self) -> None:
        """Wait until what was sent has arrived; for half a second at most."""


Connect: TypeAlias = Callable[[CommandHandler, Heartbeats | None, EventLog], AbstractContextManager[RobotNetwork]]
"""Connects a station to a network; without heartbeats it only watches."""
