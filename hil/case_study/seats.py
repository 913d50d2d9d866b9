# SPDX-License-Identifier: MIT
"""The seats of the case study: a seat is an environment that runs the model and returns where the cart went."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from segway_ecc.hil.case_study.study import Edge, Seat, Trajectory
from segway_ecc.node.sequence.manoeuvre import Manoeuvre
from segway_ecc.node.sequence.player import Odometry


@dataclass(frozen=True, slots=True)
class SeatRun:
    """What came of one manoeuvre.

    Attributes:
        trajectory: The cart's way; its last point is the end of the manoeuvre.
        graph: The ROS graph while it ran; empty without ROS.
    """

    trajectory: Trajectory
    graph: Sequence[Edge] = ()

    @property
    def position(self) -> tuple[float, float]:
        """Where the cart was at the end, m."""
        return self.trajectory.x[-1], self.trajectory.y[-1]


class SeatRunner(Protocol):
    """A seat, ready to run manoeuvres.

    Attributes:
        seat: Which one.
        jobs: How many runs may go on side by side.
    """

    seat: Seat
    jobs: int

    def run(self, name: str, manoeuvre: Manoeuvre) -> SeatRun:
        """Play a manoeuvre to a cart that stands at the origin.

        Args:
            name: A name for the run, unique in the study; letters, digits and underscores.
            manoeuvre: What to play.
        """


def trajectory(seat: Seat, points: Sequence[Odometry]) -> Trajectory:
    """The trajectory through points whose stamps are counted from the first."""
    first_ns = points[0].stamp_ns
    return Trajectory(
        seat=seat,
        time=[(p.stamp_ns - first_ns) * 1e-9 for p in points],
        x=[p.x for p in points],
        y=[p.y for p in points],
        linear_velocity=[p.linear_velocity for p in points],
        angular_velocity=[p.angular_velocity for p in points],
    )
