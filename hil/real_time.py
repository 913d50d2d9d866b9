"""The rig in real time: a device and its plant as a process of their own at the other end of a real bus."""

from typing import Final

from firmware_io.links.link import Link
from hil.devices.wheel_board import TICK_NS, SimulatedWheelBoard
from hil.simulation import Observer
from node.cycle.clock import Clock
from node.model.model import Model

_LATE_NS: Final = TICK_NS


class RealTimePlant:
    """Ticks a simulated wheel board at its own rate until it is stopped.

    A tick that comes late is made up for: the laws of physics skip nothing.

    Attributes:
        ticks: Ticks so far.
        late: Ticks that came more than a whole tick late.
    """

    def __init__(self, link: Link, plant: Model, clock: Clock) -> None:
        """Put a plant behind a wheel board on a link.

        Raises:
            PlantMismatchError: The plant does not fit the board.
        """
        self.ticks = 0
        self.late = 0
        self._clock = clock
        self._link = link
        self._plant = plant
        self._board = SimulatedWheelBoard(self._link, self._plant)
        self._stopped = False

    @property
    def description(self) -> str:
        """The bus it is on."""
        return self._link.description

    @property
    def output_names(self) -> list[str]:
        """Names of the plant's outputs."""
        return [v.name for v in self._plant.outputs]

    @property
    def refused_frames(self) -> int:
        """Frames the board refused."""
        return self._board.refused_frames

    def stop(self, _reason: str = "") -> None:
        """End after the present tick; may be called from a signal handler."""
        self._stopped = True

    def open(self) -> None:
        """Open the bus.

        Raises:
            BusNotFoundError: It is not there.
        """
        self._link.open()

    def run(self, observe: Observer | None) -> None:
        """Tick until stopped, then close the bus."""
        deadline_ns = self._clock.now_ns()
        try:
            while not self._stopped:
                self._clock.sleep_until_ns(deadline_ns)
                late_ns = self._clock.now_ns() - deadline_ns
                self.late += late_ns > _LATE_NS
                self._board.tick(self._clock.now_ns())
                if observe is not None:
                    observe(self._clock.wall_ns() - late_ns, self._board.outputs)
                self.ticks += 1
                deadline_ns += TICK_NS
        finally:
            self._link.close()
