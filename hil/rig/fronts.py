# SPDX-License-Identifier: MIT
"""Links, recorders and plants in front of others: what passes is the other's, but for what a kind of front changes."""

import enum
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.can_ports import make_can_link
from segway_ecc.firmware_io.links.link import Frame, Link, LinkCounters, LinkState
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.devices.device import advance_of
from segway_ecc.node.cycle.interfaces import CycleRecord, Recorder
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.model.model import Model

_PATIENCE_S: Final = 0.25
"""For a frame that is on its way through a kernel and its controllers; longer, and it is lost."""
_POLL_S: Final = 0.0001


class LinkFront:
    """Passes everything on to the link behind; a link that disturbs another overrides what it changes. See `Link`."""

    def __init__(self, behind: Link) -> None:
        """Stand in front of `behind`."""
        self.behind = behind

    @property
    def counters(self) -> LinkCounters:
        """Those of the link behind."""
        return self.behind.counters

    @property
    def description(self) -> str:
        """That of the link behind."""
        return self.behind.description

    @property
    def state(self) -> LinkState:
        """That of the link behind."""
        return self.behind.state

    @property
    def health(self) -> Mapping[str, str]:
        """That of the link behind."""
        return self.behind.health

    def open(self) -> None:
        """Open the link behind; see `Link.open`."""
        self.behind.open()

    def send(self, frame: Frame) -> bool:
        """Send on the link behind; see `Link.send`."""
        return self.behind.send(frame)

    def receive(self) -> list[Frame]:
        """Take what has arrived on the link behind; see `Link.receive`."""
        return self.behind.receive()

    def close(self) -> None:
        """Close the link behind."""
        self.behind.close()


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
    """A link with a fault that can be set and cleared (None) while it runs; see `Link`."""

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


class PacedLink(LinkFront):
    """One end of a real bus whose other end is in the same process; see `Link`.

    `receive` returns once every frame that the other end sent has arrived, or has been given up for lost: on the
    simulated clock the bus is then infinitely fast, however slow the kernel and its controllers are. Data frames that
    went out here are `sent`; frames of the other end that never arrived are `lost`.
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


def kernel_ends(clock: Clock, channels: tuple[str, str], can: CanSettings) -> tuple[PacedLink, PacedLink]:
    """The ends of the kernel's own CAN bus for robot and plant, in place of a simulated bus.

    Args:
        clock: It stops while a frame is on its way.
        channels: The CAN interfaces of robot and plant: one and the same, or two controllers on one bus.
        can: Its bit rates, and whether it is of CAN FD.
    """
    robot, plant = (
        PacedLink(
            make_can_link("socketcan", channel, can.bitrate, clock.now_ns, clock.wall_ns, fd_bitrate=can.fd_bitrate)
        )
        for channel in channels
    )
    robot.other, plant.other = plant, robot
    return robot, plant


class RecorderFront:
    """Passes everything on to the recorder behind; a front overrides what it observes or disturbs. See `Recorder`."""

    def __init__(self, behind: Recorder) -> None:
        """Stand in front of `behind`."""
        self._behind = behind

    def write(self, record: CycleRecord) -> None:
        """Record one cycle."""
        self._behind.write(record)

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Record a set of diagnostics."""
        self._behind.write_diagnostics(stamp_ns, statuses)

    def write_state(self, take: Callable[[], Snapshot]) -> None:
        """Record what later cycles depend on."""
        self._behind.write_state(take)

    def close(self) -> None:
        """Finish the log."""
        self._behind.close()


class PlantFront:
    """Stands between devices and plant; a kind of it overrides `advance`. See `Model`.

    What is true of the plant, `truth.*`, stays true.
    """

    def __init__(self, plant: Model) -> None:
        """Stand in front of `plant`."""
        self.name, self.step_size = plant.name, plant.step_size
        self.inputs, self.outputs = plant.inputs, plant.outputs
        self.parameters, self.states = plant.parameters, plant.states
        self._plant, self._advance = plant, advance_of(plant)

    @property
    def stopped(self) -> bool:
        """Whether the plant has asked to stop."""
        return self._plant.stopped

    def initialize(self, u: Sequence[float]) -> list[float]:
        """Start at time zero; see `Model.initialize`."""
        return self._plant.initialize(u)

    def step(self, u: Sequence[float]) -> list[float]:
        """Push with what the motors make of `u`; return what the sensors make of the outputs."""
        return self.advance(u, 1)

    def advance(self, u: Sequence[float], steps: int) -> list[float]:
        """Make some steps at once; see `Advancing`."""
        y = self._advance(u, steps)
        return y if isinstance(y, list) else list(y)

    def terminate(self) -> None:
        """Run the final section."""
        self._plant.terminate()

    def read(self, name: str) -> float:
        """The plant's own value; see `Model.read`."""
        return self._plant.read(name)

    def write(self, name: str, value: float) -> None:
        """Write to the plant; see `Model.write`."""
        self._plant.write(name, value)
