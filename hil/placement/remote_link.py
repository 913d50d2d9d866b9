# SPDX-License-Identifier: MIT
"""Balance control away from the robot: its link to the bus goes through a gateway and over the network."""

from collections.abc import Sequence
from typing import Final

from msgspec.structs import replace

from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.placement.network import Channel, NowNs
from segway_ecc.hil.rig.link_front import LinkFront

_BURST_NS: Final = 2_000_000
"""Frames that begin to arrive within this time are one snapshot, and one message."""


class RemoteLink(LinkFront):
    """The node's end of a bus that is at the other end of a network; see `Link`.

    The gateway on the robot sends each snapshot on as soon as it has passed on the bus, and puts commands on the bus
    when they arrive. Frames carry the time at which they reached the node: two machines have no common clock for
    their age.
    """

    def __init__(self, bus: Link, up: Channel[Sequence[Frame]], down: Channel[list[Frame]], now_ns: NowNs) -> None:
        """Stand at the far end of the network.

        Args:
            bus: The gateway's link to the robot's bus.
            up: From the robot: frames of the bus.
            down: To the robot: frames for the bus.
            now_ns: The rig's clock.
        """
        super().__init__(bus)
        self._up = up
        self._down = down
        self._now_ns = now_ns
        self._message: list[Frame] = []
        self._message_ns = -1

    @property
    def next_ns(self) -> int | None:
        """When the gateway next has something to put on the bus."""
        return self._down.next_ns

    def act(self) -> None:
        """Put what has arrived at the gateway on the bus."""
        for message in self._down.receive():
            for frame in message.item:
                self.behind.send(frame)

    def send(self, frame: Frame) -> bool:
        """Send over the network; what is sent at one instant is one message. See `Link.send`."""
        now_ns = self._now_ns()
        if now_ns != self._message_ns:
            self._message, self._message_ns = [], now_ns
            self._down.send(self._message)
        self._message.append(frame)
        return True

    def receive(self) -> list[Frame]:
        """What has come over the network; see `Link.receive`."""
        for burst in bursts(self.behind.receive()):
            self._up.send(burst, burst[-1].received_ns)
        return [
            replace(frame, received_ns=frame.received_ns + message.arrived_ns - message.sent_ns)
            for message in self._up.receive()
            for frame in message.item
        ]


def bursts(frames: Sequence[Frame]) -> list[list[Frame]]:
    """Frames that came together."""
    found: list[list[Frame]] = []
    for frame in frames:
        if not found or frame.received_ns - found[-1][0].received_ns > _BURST_NS:
            found.append([])
        found[-1].append(frame)
    return found
