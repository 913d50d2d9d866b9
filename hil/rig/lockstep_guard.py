# SPDX-License-Identifier: MIT
"""A guard in lock step, which takes the node's commands for heartbeats: there is no socket between both."""

from collections.abc import Iterator
from typing import Final

from segway_ecc.firmware_io.drives.stopper import Meaning, Stopper
from segway_ecc.firmware_io.guard.guard import PASS_NS, Guard, stopper_of
from segway_ecc.firmware_io.guard.watch import Watch
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.settings import HardwareSettings
from segway_ecc.hil.rig.fronts import LinkFront
from segway_ecc.hil.rig.simulation import LockstepRig

_REPORTS: Final = frozenset({Meaning.ON, Meaning.OFF})


class CommandHeartbeats(LinkFront):
    """The guard's bus, and a heartbeat for each command of the node's on it; see `HeartbeatSource`."""

    def __init__(self, link: Link, stopper: Stopper) -> None:
        """Take a heartbeat for each command on `link`."""
        super().__init__(link)
        self._stopper = stopper
        self._beats: list[bool] = []

    def receive(self) -> list[Frame]:
        """Take what has arrived; see `Link.receive`."""
        frames = super().receive()
        observed = (self._stopper.read(frame) for frame in frames)
        commands = (each.meaning for each in observed if each is not None and each.meaning not in _REPORTS)
        self._beats += [meaning is not Meaning.DISABLE for meaning in commands]
        return frames

    def take_heartbeats(self) -> Iterator[bool]:
        """Those of the commands that have been received."""
        beats, self._beats = self._beats, []
        return iter(beats)

    def answer(self, stops: str) -> None:
        """Nobody is told."""


class LockstepGuard:
    """Makes its passes on the rig's clock, until it is ended; see `Source`."""

    def __init__(self, settings: HardwareSettings, rig: LockstepRig) -> None:
        """Guard the drives on the bus of `rig`, from now on."""
        stopper = stopper_of(settings)
        self.watch = Watch(stopper, rig.now_ns())
        self.next_ns: int | None = rig.now_ns()
        beats = CommandHeartbeats(rig.bus.attach("guard"), stopper)
        self._guard = Guard(beats, beats, self.watch, rig)
        self._rig = rig

    def act(self) -> None:
        """One pass."""
        self._guard.step()
        self.next_ns = self._rig.now_ns() + PASS_NS

    def end(self) -> None:
        """Watch no more."""
        self.next_ns = None
