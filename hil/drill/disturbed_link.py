"""The drives' end of a bus, which can be muted or cut while it runs."""

import enum

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.rig.link_front import LinkFront


@enum.unique
class Disturbance(enum.StrEnum):
    """What is wrong with the bus."""

    MUTE = "mute"
    """The drives hear, and what they send is lost."""
    CUT = "cut"
    """Nothing passes either way."""


class DisturbedLink(LinkFront):
    """A link that loses frames as it is told to; a cut cable is not seen from this end. See `Link`.

    Attributes:
        disturbance: What is wrong at the moment; None while all is well.
    """

    def __init__(self, link: Link) -> None:
        """Stand in front of `link`."""
        super().__init__(link)
        self.disturbance: Disturbance | None = None

    def send(self, frame: Frame) -> bool:
        """Send, or lose the frame."""
        return self.behind.send(frame) if self.disturbance is None else True

    def receive(self) -> list[Frame]:
        """Receive, or lose what has arrived."""
        try:
            frames = self.behind.receive()
        except LinkLostError:
            if self.disturbance is Disturbance.CUT:
                return []
            raise
        return [] if self.disturbance is Disturbance.CUT else frames
