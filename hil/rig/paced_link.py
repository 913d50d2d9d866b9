# SPDX-License-Identifier: MIT
"""Lock step over a real bus: simulated time stops until everything that was sent has arrived."""

import time
from collections.abc import Callable
from typing import Final

from segway_ecc.firmware_io.links.can_ports import make_can_link
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.rig.link_front import LinkFront
from segway_ecc.hil.rig.lockstep import LockstepRig

_PATIENCE_S: Final = 0.25
"""For a frame that is on its way through a kernel and its controllers; longer, and it is lost."""
_POLL_S: Final = 0.0001


class PacedLink(LinkFront):
    """One end of a real bus whose other end is in the same process; see `Link`.

    `receive` returns once every frame that the other end sent has arrived, or has been given up for lost: on the
    simulated clock the bus is then infinitely fast, however slow the kernel and its controllers are.

    Attributes:
        sent: Data frames that went out here.
        lost: Frames of the other end that never arrived here.
        other: The other end.
    """

    def __init__(self, link: Link, sleep: Callable[[float], None] = time.sleep) -> None:
        """Pace a link; its other end is to be named before anything is received."""
        super().__init__(link)
        self.sent = 0
        self.lost = 0
        self.other: PacedLink | None = None
        self._sleep = sleep

    @property
    def description(self) -> str:
        """Which bus it is."""
        return f"{self.behind.description}, in lock step"

    def send(self, frame: Frame) -> bool:
        """Send, and count what the other end must wait for."""
        was_sent = self.behind.send(frame)
        self.sent += was_sent and not frame.is_remote
        return was_sent

    def receive(self) -> list[Frame]:
        """Everything that the other end has sent."""
        frames = self.behind.receive()
        sent, deadline_s = 0 if self.other is None else self.other.sent, time.monotonic() + _PATIENCE_S
        while (missing := sent - self.lost - self.counters.received) > 0 and time.monotonic() < deadline_s:
            self._sleep(_POLL_S)
            frames += self.behind.receive()
        self.lost += max(missing, 0)
        return frames


def kernel_ends(rig: LockstepRig, channels: tuple[str, str], bitrate: int) -> tuple[PacedLink, PacedLink]:
    """The ends of the kernel's own CAN bus for robot and plant, in place of a simulated bus.

    Args:
        rig: Its clock stops while a frame is on its way.
        channels: The CAN interfaces of robot and plant: one and the same, or two controllers on one bus.
        bitrate: In bit/s.
    """
    robot, plant = (
        PacedLink(make_can_link("socketcan", channel, bitrate, rig.now_ns, rig.wall_ns)) for channel in channels
    )
    robot.other, plant.other = plant, robot
    return robot, plant
