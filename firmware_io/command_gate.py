# SPDX-License-Identifier: MIT
"""Whether commands may leave: the bus is ours, nobody else commands on it, the guard stops nothing, none is too old."""

import contextlib
from collections.abc import Collection, Iterator, Mapping, MutableSequence, Sequence
from typing import Final

from segway_ecc.firmware_io.devices import Drive, FrameKey
from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.heartbeat import BusOwnedError, Ownership
from segway_ecc.firmware_io.links.link import Link, NowNs
from segway_ecc.firmware_io.strangers import Strangers

_LOOKS: Final = 5
"""At the bus before anything is sent there, a pause apart: a controller that runs sends more often."""
_NO_GUARD: Final = (
    "no guard watches this bus: start `segway-ecc guard` with this robot, or set hardware.guard: optional"
)
_GUARD_LOST: Final = (
    "the guard of this bus has ended or does not answer: only the drives' own watchdog is left; start it again"
)
_GUARD_BACK: Final = "the guard of this bus is back"


class CommandGate:
    """Passed by every command of an armed robot; what it refuses once, it refuses until the robot is armed again.

    Commands that are older than the drives' watchdog allows do not pass: the drives have acted meanwhile.

    Attributes:
        faults: Why commands do not pass; empty while they do.
        strangers: Frames of others under our identifiers.
    """

    def __init__(self, drives: Sequence[Drive], owner: Ownership | None, stale_ns: int | None, now_ns: NowNs) -> None:
        """Guard the way to `drives`.

        Args:
            drives: What is commanded.
            owner: Claims the bus and sends the guard a heartbeat; None on a bus that nobody else can reach.
            stale_ns: How long after the last commands the next may leave, ns; None for any time.
            now_ns: The clock of the loop.
        """
        self.faults: tuple[str, ...] = ()
        ours: Collection[FrameKey] = {key for drive in drives for key in map(FrameKey._make, drive.commanded_by)}
        self.strangers = Strangers(ours, now_ns)
        self._drives = tuple(drives)
        self._owner = owner
        self._stale_ns = stale_ns
        self._now_ns = now_ns
        self._sent_ns = 0
        self._has_guard = self._lost_guard = self._was_strange = False

    def claim(self) -> None:
        """Claim the bus; see `Ownership.open`."""
        if self._owner is not None:
            self._owner.open()

    def look_for_another(self, link: Link) -> None:
        """See that nobody commands the drives, before anything is sent on `link`; a guard may be stopping them.

        Raises:
            BusOwnedError: Somebody does; the link is closed, so that not even a zero is sent on the way out.
        """
        owner, found, stops = self._owner, "", ""
        if owner is None:
            return
        for _ in range(_LOOKS):
            owner.beat(is_on=False)
            owner.pause()
            with contextlib.suppress(LinkLostError):
                for frame in link.receive():
                    self.strangers.take_frame(frame)
            found, stops = self.strangers.report() or found, owner.stops or stops
        owner.beat(is_on=False)
        if found and not (stops or owner.stops):
            where = link.description
            link.close()
            raise BusOwnedError(f"{where}: {found}")

    def begin(self) -> None:
        """Let the commands of a robot that is being armed pass."""
        self.faults, self._sent_ns = (), self._now_ns()

    def end(self) -> None:
        """The robot is disarmed."""
        self.faults = ()
        if self._owner is not None:
            self._owner.beat(is_on=False)

    def passes(self, events: MutableSequence[str], *, is_armed: bool) -> bool:
        """Whether this cycle's commands may leave; the guard's heartbeat goes first. What happened joins `events`."""
        stops = ""
        if self._owner is not None:
            stops = self._beat(self._owner, events, is_on=is_armed and not self.faults)
        now_ns, found = self._now_ns(), self._new_strangers(events, is_armed=is_armed, is_guard=bool(stops))
        if is_armed and not self.faults:
            self.faults = tuple(self._reasons(now_ns - self._sent_ns, stops, found))
            if self.faults and self._owner is not None:
                self._owner.beat(is_on=False)
        self._sent_ns = now_ns
        return not self.faults

    def arming_failures(self) -> Iterator[str]:
        """Why the robot may not be armed, each with the remedy."""
        yield from self.strangers.arming_failures()
        owner = self._owner
        if owner is None:
            return
        if owner.stops:
            yield f"the guard is stopping the drives: {owner.stops}; wait, or see what drives them"
        elif owner.needs_guard and not owner.has_guard:
            yield _NO_GUARD

    @property
    def health(self) -> Mapping[str, str]:
        """Commands of others, telemetry that is not the devices' alone, and whether a guard watches."""
        health = {"strange_commands": str(self.strangers.total), "doubled_telemetry": str(self.strangers.doubled)}
        if self._owner is not None:
            health["guard"] = "watches" if self._owner.has_guard else "lost" if self._lost_guard else "none"
        return health

    def close(self) -> None:
        """Give the bus back."""
        if self._owner is not None:
            self._owner.close()

    def _beat(self, owner: Ownership, events: MutableSequence[str], *, is_on: bool) -> str:
        """Send a heartbeat; report a guard that has gone or is back, and return why it stops the drives."""
        owner.beat(is_on=is_on)
        before, self._has_guard = self._has_guard, owner.has_guard
        if before and not self._has_guard:
            self._lost_guard = True
            events.append(_GUARD_LOST)
        elif self._has_guard and self._lost_guard:
            self._lost_guard = False
            events.append(_GUARD_BACK)
        return owner.stops

    def _new_strangers(self, events: MutableSequence[str], *, is_armed: bool, is_guard: bool) -> str:
        """Name the frames that others sent since the last time; of a robot at rest an event, once while they last."""
        was_recent, self._was_strange = self._was_strange, self.strangers.is_recent
        found = self.strangers.report()
        if found and not (is_armed or was_recent or is_guard):
            events.append(found)
        return found

    def _reasons(self, silent_ns: int, stops: str, strangers: str) -> Iterator[str]:
        """Why commands must not leave, by who acted."""
        is_stale = self._stale_ns is not None and silent_ns > self._stale_ns
        if stops:
            yield f"the guard stopped the drives: {stops}"
        elif strangers:
            yield strangers
        if is_stale:
            yield f"this node sent no command for {silent_ns * 1e-6:.0f} ms"
        if stops or strangers or is_stale:
            for drive in self._drives:
                yield from drive.faults()
