# SPDX-License-Identifier: MIT
"""The rig in real time: the devices and their plant as a process of their own at the other end of a real bus."""

from collections.abc import Callable, Sequence

from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import Observer
from segway_ecc.node.cycle.clock import Clock

Trace = Callable[[int, int, Sequence[float]], None]
"""Called after each tick with the monotonic and the wall-clock time at which it began, ns, and what the motors give."""


class RealTimePlant:
    """Ticks a simulated robot at its own rate until it is stopped.

    A tick that comes late is made up for: the laws of physics skip nothing.

    Attributes:
        ticks: Ticks so far.
        late: Ticks that came more than a whole tick late.
        robot: What is ticked.
    """

    def __init__(self, robot: SimulatedRobot, clock: Clock) -> None:
        """Tick a robot on a clock."""
        self.ticks = 0
        self.late = 0
        self.robot = robot
        self._clock = clock
        self._stopped = False

    def stop(self, _reason: str = "") -> None:
        """End after the present tick; may be called from a signal handler."""
        self._stopped = True

    def run(
        self,
        observe: Observer | None,
        trace: Trace | None = None,
        before_tick: Callable[[], None] | None = None,
    ) -> None:
        """Tick until stopped, then close the bus, which is open.

        Args:
            observe: Sees the plant's outputs.
            trace: Sees what the motors give, when they really give it.
            before_tick: Called before each tick; what it changes is in force in that tick.
        """
        deadline_ns, tick_ns = self._clock.now_ns(), self.robot.tick_ns
        try:
            while not self._stopped:
                self._clock.sleep_until_ns(deadline_ns)
                late_ns = self._clock.now_ns() - deadline_ns
                self.late += late_ns > tick_ns
                if before_tick is not None:
                    before_tick()
                now_ns, wall_ns = self._clock.now_ns(), self._clock.wall_ns()
                self.robot.tick(now_ns)
                if trace is not None:
                    trace(now_ns, wall_ns, self.robot.inputs)
                if observe is not None:
                    observe(self._clock.wall_ns() - late_ns, self.robot.outputs)
                self.ticks += 1
                deadline_ns += tick_ns
        finally:
            self.robot.link.close()
