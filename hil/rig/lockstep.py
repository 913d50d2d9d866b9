# SPDX-License-Identifier: MIT
"""The rig on a simulated clock: the node and the devices take turns, and the same seed gives the same bits."""

from typing import Final, Protocol

from segway_ecc.hil.rig.simulated_bus import SimulatedBus
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import Observer

WALL_START_NS: Final = 1_700_000_000_000_000_000
"""What the simulated wall clock reads at monotonic time zero."""


class Source(Protocol):
    """Something that acts at times of its own."""

    @property
    def next_ns(self) -> int | None:
        """When it is next to act; None while it is not to."""

    def act(self) -> None:
        """Do what is due now."""


class LockstepRig:
    """A clock that, whenever the node waits, lets the devices run up to the moment the node waits for.

    Its time stops wherever a source is to act.
    """

    def __init__(self, bitrate: int) -> None:
        """Make a rig with an empty bus at `bitrate` bit/s."""
        self.bus = SimulatedBus(bitrate, self.now_ns)
        self._robot: SimulatedRobot | None = None
        self._observe: Observer | None = None
        self._sources: list[Source] = []
        self._now_ns = 0
        self._next_tick_ns = 0

    def attach(self, robot: SimulatedRobot, observe: Observer | None = None) -> None:
        """Let a simulated robot take part; `observe` is called after each of its ticks."""
        self._robot, self._observe = robot, observe

    def add(self, source: Source) -> None:
        """Let a source act."""
        self._sources.append(source)

    def now_ns(self) -> int:
        """Simulated monotonic time."""
        return self._now_ns

    def wall_ns(self) -> int:
        """Simulated wall-clock time."""
        return WALL_START_NS + self._now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Let the devices run, and the sources act, up to the deadline."""
        while (
            due_ns := min((at for s in self._sources if (at := s.next_ns) is not None), default=deadline_ns)
        ) < deadline_ns:
            self._run_until(due_ns)
            for source in self._sources:
                if source.next_ns is not None and source.next_ns <= due_ns:
                    source.act()
        self._run_until(deadline_ns)

    def _run_until(self, deadline_ns: int) -> None:
        robot = self._robot
        while robot is not None and self._next_tick_ns < deadline_ns:
            self._now_ns = self._next_tick_ns
            robot.tick(self._now_ns)
            if self._observe is not None:
                self._observe(self.wall_ns(), robot.outputs)
            self._next_tick_ns += robot.tick_ns
        self._now_ns = max(self._now_ns, deadline_ns)
