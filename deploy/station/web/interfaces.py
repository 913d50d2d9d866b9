# SPDX-License-Identifier: MIT
"""What the web side needs of a station."""

from collections.abc import Callable, Mapping, Sequence
from typing import IO, Protocol, TypeAlias

from segway_ecc.deploy.station.archive_client import Progress
from segway_ecc.deploy.station.requests import Reply
from segway_ecc.deploy.station.views import Command, Drive, FleetStatus
from segway_ecc.deploy.support.log_folder import LogFile
from segway_ecc.node.cycle.setpoints import Setpoint

Bundle: TypeAlias = Callable[[str], IO[bytes]]
"""Makes the support bundle of a robot, a zip, as an open file with a descriptor, which is the caller's to close; it may
take a minute, and is called in a thread of its own."""


class Archive(Protocol):
    """Fetches the logs of robots; `deploy.station.archive_client.ArchiveClient` is one. Its methods may wait."""

    def logs(self, robot: str) -> Sequence[LogFile]:
        """The logs that a robot offers; raises a NodeError with the reason where it offers none."""

    def begin(self, robot: str, name: str) -> None:
        """Begin to fetch one; raises a NodeError with the reason where it cannot."""

    def progress(self, robot: str) -> Mapping[str, Progress]:
        """The progress of a robot's logs, by name; does not wait."""

    def open(self, robot: str, name: str) -> tuple[int, int]:
        """The descriptor and size of one that was fetched; raises FileNotFoundError."""

    def close(self) -> None:
        """End all fetches; may be called again."""


class CommandSink(Protocol):
    """Accepts operators' commands; nothing of it waits."""

    @property
    def limits(self) -> Setpoint:
        """The fastest that may be requested, m/s and rad/s."""

    def submit(self, who: str, command: Command, reply: Reply) -> None:
        """Have a command carried out; the reply may come from any thread."""

    def drive(self, who: str, drive: Drive) -> None:
        """Have a robot driven."""

    def leave(self, who: str) -> None:
        """An operator is gone."""


class Robots(FleetStatus, CommandSink, Protocol):
    """Both sides of a station; `deploy.station.station.Station` is one, and a test's script another.

    Seven methods in two interfaces: what only shows robots needs the three of `FleetStatus`.
    """
