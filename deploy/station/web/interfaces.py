"""What the web side needs of a station."""

from collections.abc import Callable, Mapping, Sequence
from typing import IO, Protocol, TypeAlias

from segway_ecc.deploy.station.archive_client import Progress
from segway_ecc.deploy.station.connection import Reply
from segway_ecc.deploy.station.views import Command, Drive, EventView, FleetView
from segway_ecc.deploy.support.log_folder import LogFile
from segway_ecc.node.cycle.setpoints import Setpoint

Bundle: TypeAlias = Callable[[str], IO[bytes]]
"""Makes the support bundle of a robot, a zip, as an open file with a descriptor, which is the caller's to close; it may
take a minute, and is called in a thread of its own."""


class Archive(Protocol):
    """Fetches the logs of robots; `deploy.station.archive_client.ArchiveClient` is one. Its methods may wait."""

    def logs(self, robot: str) -> Sequence[LogFile]:
        """Which a robot hands out; raises a NodeError that says why it does not."""

    def begin(self, robot: str, name: str) -> None:
        """Begin to fetch one; raises a NodeError that says why not."""

    def progress(self, robot: str) -> Mapping[str, Progress]:
        """How far those of a robot are; does not wait."""

    def open(self, robot: str, name: str) -> tuple[int, int]:
        """The descriptor and size of one that was fetched; raises FileNotFoundError."""

    def close(self) -> None:
        """End what goes on; may be called again."""


class Robots(Protocol):
    """The robots; `deploy.station.station.Station` is one, and a test's script another. Nothing of it waits."""

    @property
    def limits(self) -> Setpoint:
        """The fastest that may be asked for."""

    def fleet(self) -> FleetView:
        """The newest picture."""

    def events(self, after: int) -> Sequence[EventView]:
        """What happened since."""

    def refused(self) -> Mapping[str, int]:
        """What the station itself refused, by cause."""

    def submit(self, who: str, command: Command, reply: Reply) -> None:
        """Have a command carried out; the reply may come from any thread."""

    def drive(self, who: str, drive: Drive) -> None:
        """Have a robot driven."""

    def leave(self, who: str) -> None:
        """Somebody is gone."""
