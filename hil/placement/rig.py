"""The rig in lock step with things that happen at times of their own, between the ticks of the devices."""

from typing import Protocol

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
        while (due_ns := self._next_ns()) is not None and due_ns < deadline_ns:
            super().sleep_until_ns(due_ns)
            for source in self._sources:
                if source.next_ns is not None and source.next_ns <= due_ns:
                    source.act()
        super().sleep_until_ns(deadline_ns)

    def _next_ns(self) -> int | None:
        return min((at_ns for source in self._sources if (at_ns := source.next_ns) is not None), default=None)
