# SPDX-License-Identifier: MIT
"""Sequence control without ROS: the player sits in the loop's own stage."""

from collections.abc import Sequence

from segway_ecc.node.cycle.clock import Clock
from segway_ecc.node.cycle.interfaces import Inbox, NoStage, Report, StampedSetpoint
from segway_ecc.node.cycle.wiring import ODOMETRY_SIGNALS
from segway_ecc.node.safety.modes import ACTIVE
from segway_ecc.node.sequence.player import Odometry, Player, PlayState


class ManoeuvreStage(NoStage):
    """A stage that plays one manoeuvre once the robot is armed, and then ends; see `Stage`.

    Attributes:
        is_broken_off: Whether the robot disarmed before the end.
        started_wall_ns: The wall clock in the cycle that has the stamp of the start; None until then. The stamps
            count model time: where deadlines were skipped before the start, they are behind the wall clock.
    """

    def __init__(self, player: Player, signals: Sequence[str], clock: Clock) -> None:
        """Play to a robot that publishes `signals`; those of the odometry that it lacks count as zero."""
        self.player = player
        self._indices = [signals.index(name) if name in signals else None for name in ODOMETRY_SIGNALS]
        self.over: str | None = None
        self.is_broken_off = False
        self.started_wall_ns: int | None = None
        self._clock = clock

    def take_inbox(self) -> Inbox:
        """The set-points that are to be sent now."""
        inbox = Inbox()
        start_ns = self.player.start_ns or 0
        inbox.setpoints += [StampedSetpoint(s.setpoint, start_ns + s.offset_ns) for s in self.player.due_setpoints()]
        return inbox

    def publish(self, report: Report) -> None:
        """Pass the robot's odometry to the player."""
        if report.mode not in ACTIVE:
            if self.player.start_ns is not None:
                self.over = "the robot left the sequence"
                self.is_broken_off = True
        else:
            values = [0.0 if index is None else report.values[index] for index in self._indices]
            if self.player.update(Odometry(report.stamp_ns, *values)) is PlayState.DONE:
                self.over = "the sequence is over"
            if self.started_wall_ns is None and self.player.received:
                self.started_wall_ns = self._clock.wall_ns()
