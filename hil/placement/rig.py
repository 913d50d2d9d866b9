# SPDX-License-Identifier: MIT
"""The rig in lock step with what happens at times of its own, between the ticks of the devices; and the guard."""

from collections.abc import Iterator
from typing import Protocol

from segway_ecc.firmware_io.build import Clocks, HardwareSettings
from segway_ecc.firmware_io.guard.guard import PASS_NS, Guard, stopper_of
from segway_ecc.firmware_io.guard.watch import Watch
from segway_ecc.hil.rig.lockstep import LockstepRig


class Source(Protocol):
    """Something that acts at times of its own."""

    @property
    def next_ns(self) -> int | None:
        """When it is next to act; None while it is not to."""

    def act(self) -> None:
        """Do what is due now."""


class EventRig(LockstepRig):
    """A rig whose time stops wherever a source is to act; see `LockstepRig`."""

    def __init__(self, bitrate: int) -> None:
        """Make a rig with an empty bus at `bitrate` bit/s."""
        super().__init__(bitrate)
        self._sources: list[Source] = []

    def add(self, source: Source) -> None:
        """Let a source act."""
        self._sources.append(source)

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Let the devices run, and the sources act, up to the deadline."""
        while (
            due_ns := min((at for s in self._sources if (at := s.next_ns) is not None), default=deadline_ns)
        ) < deadline_ns:
            super().sleep_until_ns(due_ns)
            for source in self._sources:
                if source.next_ns is not None and source.next_ns <= due_ns:
                    source.act()
        super().sleep_until_ns(deadline_ns)


class NoHeartbeats:
    """Nobody beats: a node on the other side of a network cannot, and its commands are on the bus. See `Beats`."""

    def open(self) -> None:
        """There is nothing to open."""

    def take_heartbeats(self) -> Iterator[bool]:
        """None has arrived."""
        return iter(())

    def close(self) -> None:
        """There is nothing to close."""


class LockstepGuard:
    """Makes its passes on the rig's clock; see `Source`.

    Attributes:
        watch: What it watches and decides.
        next_ns: When its next pass is.
    """

    def __init__(self, settings: HardwareSettings, rig: LockstepRig) -> None:
        """Guard the drives on the bus of `rig`."""
        self.watch = Watch(stopper_of(settings), rig.now_ns())
        self.next_ns = 0
        ears, voice = rig.bus.attach("guard's ears"), rig.bus.attach("guard's voice")
        clocks = Clocks(rig.now_ns, rig.wall_ns, rig.sleep_until_ns)
        self._guard = Guard(ears, voice, NoHeartbeats(), self.watch, clocks)

    def act(self) -> None:
        """One pass."""
        self._guard.step()
        self.next_ns += PASS_NS
