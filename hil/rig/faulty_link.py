# SPDX-License-Identifier: MIT
"""A link that fails on request, in front of one that works."""

import enum
from collections.abc import Mapping

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame, Link, LinkState
from segway_ecc.hil.rig.link_front import LinkFront


@enum.unique
class LinkFault(enum.StrEnum):
    """How a bus is lost; each as the kernel and the wire show it to a program."""

    STALE = "stale telemetry"
    """The drives' frames do not arrive; what is sent does."""
    CUT = "cable cut"
    """Nothing passes either way, and nothing reports it."""
    PASSIVE = "error-passive"
    """Nobody acknowledges: frames are taken, and stay in the controller."""
    BUS_OFF = "bus-off"
    """The controller has left the bus."""
    QUEUE_FULL = "transmit failures"
    """The transmit queue takes nothing; telemetry goes on."""
    UNPLUGGED = "adapter unplugged"
    """The interface is not there any more."""


_STATES = {LinkFault.PASSIVE: LinkState.PASSIVE, LinkFault.BUS_OFF: LinkState.BUS_OFF}
_SENDS_INTO_THE_VOID = frozenset({LinkFault.CUT, LinkFault.PASSIVE})
_REFUSES_TO_SEND = frozenset({LinkFault.BUS_OFF, LinkFault.QUEUE_FULL, LinkFault.UNPLUGGED})
_RECEIVES = frozenset({None, LinkFault.QUEUE_FULL})


class FaultyLink(LinkFront):
    """A link with a fault that can be set and cleared while it runs; see `Link`.

    Attributes:
        fault: What is wrong at the moment; None while all is well.
    """

    def __init__(self, link: Link) -> None:
        """Stand in front of `link`."""
        super().__init__(link)
        self.fault: LinkFault | None = None

    @property
    def state(self) -> LinkState:
        """What the fault shows, else the state of the link behind."""
        if self.fault is LinkFault.UNPLUGGED:
            return LinkState.GONE
        return self.behind.state if self.fault is None else _STATES.get(self.fault, self.behind.state)

    @property
    def health(self) -> Mapping[str, str]:
        """That of the link behind, with the state that the fault shows."""
        return {**self.behind.health, "state": str(self.state)}

    def send(self, frame: Frame) -> bool:
        """Send, or fail to; see `Link.send`."""
        if self.fault in _REFUSES_TO_SEND:
            self.counters.send_dropped += 1
            return False
        return True if self.fault in _SENDS_INTO_THE_VOID else self.behind.send(frame)

    def receive(self) -> list[Frame]:
        """Receive, or fail to; see `Link.receive`."""
        frames = self.behind.receive()
        if self.fault is LinkFault.UNPLUGGED:
            raise LinkLostError(f"{self.description} is gone: unplugged")
        return frames if self.fault in _RECEIVES else []
