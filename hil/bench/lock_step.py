"""How much faster than real time a robot, its bus, its drives and its plant run together in lock step."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from segway_ecc.hil.case_study.can import LockstepCanSeat
from segway_ecc.hil.endurance.endurance import drive
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.clock import RealClock
from segway_ecc.node.robot import build_robot
from segway_ecc.node.sequence.manoeuvre import single_segment

_REPETITIONS: Final = 3
_CART: Final = "cart-can"
_SEGWAY: Final = "segway"
SEGWAY_WANTED: Final = 50.0
"""Times real time: what the segway's lock step is to be."""


@dataclass(frozen=True, slots=True)
class LockStep:
    """A robot in lock step over the simulated bus, without a log.

    Attributes:
        robot: The robot.
        rate_hz: Its loop's.
        simulated_s: How long it drove in its own time.
        median_s: How long that took.
    """

    robot: str
    rate_hz: float
    simulated_s: float
    median_s: float

    @property
    def times_real_time(self) -> float:
        """How much faster than real time."""
        return self.simulated_s / self.median_s


def lock_step(cart_s: float = 10.0, segway_s: float = 10.0) -> list[LockStep]:
    """Drive the cart through a cell of the case study, and the segway through its street, several times each."""
    seat, manoeuvre = LockstepCanSeat(None, _CART), single_segment(2.0, 2.0, cart_s)
    segway = load_robot(_SEGWAY)
    return [
        _timed(_CART, cart_s, lambda: seat.run("bench", manoeuvre)),
        _timed(_SEGWAY, segway_s, lambda: drive(segway, 0, segway_s, 0.0)),
    ]


def _timed(robot: str, simulated_s: float, run: Callable[[], object]) -> LockStep:
    durations = []
    for _ in range(_REPETITIONS):
        began_s = time.perf_counter()
        run()
        durations.append(time.perf_counter() - began_s)
    rate_hz = 1e9 / build_robot(load_robot(robot), RealClock()).period_ns
    return LockStep(robot, rate_hz, simulated_s, statistics.median(durations))
