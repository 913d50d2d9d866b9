"""The rig on a simulated clock: the node and the device take turns, and the same seed gives the same bits."""

from typing import Final

from hil.devices.wheel_board import TICK_NS, SimulatedWheelBoard
from hil.simulated_bus import SimulatedBus
from hil.simulation import Observer
from node.model.model import Model

WALL_START_NS: Final = 1_700_000_000_000_000_000
"""What the simulated wall clock reads at monotonic time zero."""


class LockstepRig:
    """A clock that, whenever the node waits, lets the device run up to the moment the node waits for.

    Attributes:
        bus: The bus between them.
        board: The device, once `attach_board` has put it there.
    """

    def __init__(self, bitrate: int) -> None:
        """Make a rig with an empty bus at `bitrate` bit/s."""
        self.bus = SimulatedBus(bitrate, self.now_ns)
        self.board: SimulatedWheelBoard | None = None
        self._observe: Observer | None = None
        self._now_ns = 0
        self._next_tick_ns = 0

    def attach_board(self, plant: Model, observe: Observer | None = None) -> SimulatedWheelBoard:
        """Put a wheel board with `plant` behind it on the bus; `observe` is called after each of its ticks."""
        self._observe = observe
        self.board = SimulatedWheelBoard(self.bus.attach("wheel board"), plant)
        return self.board

    def now_ns(self) -> int:
        """Simulated monotonic time."""
        return self._now_ns

    def wall_ns(self) -> int:
        """Simulated wall-clock time."""
        return WALL_START_NS + self._now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Let the device run up to the deadline."""
        while self._next_tick_ns < deadline_ns:
            self._now_ns = self._next_tick_ns
            if self.board is not None:
                self.board.tick(self._now_ns)
                if self._observe is not None:
                    self._observe(self.wall_ns(), self.board.outputs)
            self._next_tick_ns += TICK_NS
        self._now_ns = max(self._now_ns, deadline_ns)
