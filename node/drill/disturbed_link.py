"""The drives' end of a bus, which can be muted or cut while it runs."""

import enum
from collections.abc import Mapping

from firmware_io.errors import LinkLostError
from firmware_io.links.base_can_link import BaseCanLink
from firmware_io.links.link import Frame, Link, LinkCounters, LinkState


@enum.unique
class Disturbance(enum.StrEnum):
    """What is wrong with the bus."""

    MUTE = "mute"
    """The drives hear, and what they send is lost."""
    CUT = "cut"
    """Nothing passes either way."""


class DisturbedLink:
    """A link that loses frames as it is told to; see `Link`.

    Attributes:
        disturbance: What is wrong at the moment; None while all is well.
    """

    def __init__(self, link: Link) -> None:
        """Stand in front of `link`."""
        self.disturbance: Disturbance | None = None
        self._link = link
        if isinstance(link, BaseCanLink):
            link.hears_remote = True  # as any end of a bus with simulated devices; they see us in its place

    @property
    def counters(self) -> LinkCounters:
        """Those of the link behind."""
        return self._link.counters

    @property
    def description(self) -> str:
        """That of the link behind."""
        return self._link.description

    @property
    def state(self) -> LinkState:
        """That of the link behind: a cut cable is not seen from this end."""
        return self._link.state

    @property
    def health(self) -> Mapping[str, str]:
        """That of the link behind."""
        return self._link.health

    def open(self) -> None:
        """Open the link behind."""
        self._link.open()

    def send(self, frame: Frame) -> bool:
        """Send, or lose the frame."""
        return self._link.send(frame) if self.disturbance is None else True

    def receive(self) -> list[Frame]:
        """Receive, or lose what has arrived."""
        try:
            frames = self._link.receive()
        except LinkLostError:
            if self.disturbance is Disturbance.CUT:
                return []
            raise
        return [] if self.disturbance is Disturbance.CUT else frames

    def close(self) -> None:
        """Close the link behind."""
        self._link.close()
