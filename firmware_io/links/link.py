"""The seam between a drive and the wire, and what is counted there."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import NamedTuple, Protocol


class Frame(NamedTuple):
    """A classic CAN data frame.

    Attributes:
        arbitration_id: 11 bits, or 29 where `is_extended`.
        data: 0 to 8 bytes.
        received_ns: When it arrived, on the clock of the loop, ns; 0 for a frame to be sent.
        is_extended: Whether the identifier is a 29-bit one.
    """

    arbitration_id: int
    data: bytes
    received_ns: int = 0
    is_extended: bool = False


@dataclass(slots=True)
class LinkCounters:
    """What passed over a link since it was opened, and what did not."""

    sent: int = 0
    received: int = 0
    send_dropped: int = 0
    """Frames the transmit queue had no room for."""
    error_frames: int = 0
    remote_frames: int = 0
    undecodable: int = 0
    """Received data that was no frame at all."""

    def as_text(self) -> Mapping[str, str]:
        """Every count by name."""
        return {name: str(count) for name, count in asdict(self).items()}


class Link(Protocol):
    """A bus as the loop uses it: nothing here waits, except `open`."""

    counters: LinkCounters

    @property
    def description(self) -> str:
        """Which bus this is, for people."""

    def open(self) -> None:
        """Open the bus.

        Raises:
            BusNotFoundError: The bus is not there or cannot be used.
        """

    def send(self, frame: Frame) -> bool:
        """Queue a frame; False where it was dropped, which is counted."""

    def receive(self) -> list[Frame]:
        """Take every data frame that has arrived, oldest first; anything else is counted.

        Raises:
            LinkLostError: The bus is gone.
        """

    def close(self) -> None:
        """Close the bus; a closed link may be closed again."""
