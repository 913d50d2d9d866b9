# SPDX-License-Identifier: MIT
"""What is observed of a robot that is driven for hours: extremes, and why it stopped driving."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from segway_ecc.hil.faults.injection import Timeline
from segway_ecc.hil.rig.recorder_front import RecorderFront
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.node.cycle.interfaces import CycleRecord, Recorder
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.safety.modes import Mode, Modes

SETTLED_AFTER_S: Final = 3.0
"""How long a set-point stands before the robot's error from it counts, s."""
_ARMED_WITHIN_S: Final = 5.0


class Trip(NamedTuple):
    """A robot that stopped following its driver.

    Attributes:
        at_s: When, s since power-on.
        mode: The mode that was entered.
        reason: Why.
    """

    at_s: float
    mode: str
    reason: str


class DriveMonitor(RecorderFront):
    """Observes the plant tick by tick and the node cycle by cycle; see `Recorder`.

    Attributes:
        modes: The robot's; set once its loop is there.
        trip: The first mode other than ARMED after it was armed, or that it never was; None while all is well.
        max_tilt: Largest tilt either way, rad; 0 where the plant has none.
        max_errors: Largest errors of velocity, m/s, and yaw rate, rad/s, while a set-point stood.
    """

    def __init__(self, robot: SimulatedRobot, period_s: float, timeline: Timeline, recorder: Recorder) -> None:
        """Observe a robot with this period of its loop, s, in front of its recorder."""
        super().__init__(recorder)
        self.modes: Modes | None = None
        self.trip: Trip | None = None
        self.max_tilt = 0.0
        self.max_errors = (0.0, 0.0)
        self._robot = robot
        self._period_s = period_s
        self._timeline = timeline
        names = robot.output_names
        self._pitch = names.index("truth.pitch") if "truth.pitch" in names else None
        self._moving = [names.index(f"truth.{name}") for name in ("linear_velocity", "angular_velocity")]
        self._setpoint = Setpoint(math.nan, math.nan)
        self._stood = 0
        self._settled = round(SETTLED_AFTER_S / self._period_s)
        self._cycle = 0

    def look(self, _wall_ns: int, outputs: Sequence[float]) -> None:
        """Observe one tick, with the plant's outputs after it."""
        if self._pitch is not None and self.trip is None:
            self.max_tilt = max(self.max_tilt, abs(outputs[self._pitch]))

    def write(self, record: CycleRecord) -> None:
        """Observe one cycle, and record it."""
        self._cycle = record.cycle
        if record.mode is Mode.ARMED:
            self._timeline.start()
            self._stood = self._stood + 1 if record.setpoint == self._setpoint else 0
            self._setpoint = record.setpoint
            if self._stood >= self._settled:
                self.max_errors = tuple(  # type: ignore[assignment]  # two of them
                    max(largest, abs(self._robot.outputs[place] - wanted))
                    for largest, place, wanted in zip(self.max_errors, self._moving, record.setpoint, strict=True)
                )
        elif self._timeline.started_ns is not None or record.cycle * self._period_s > _ARMED_WITHIN_S:
            self._note(record.mode)
        super().write(record)

    def stop(self, reason: str) -> None:
        """The loop ended by an error."""
        self.trip = self.trip or Trip(self._cycle * self._period_s, "stopped", reason)

    def end(self) -> None:
        """The time is up."""
        if self._timeline.started_ns is None:
            self._note(Mode.DISARMED)

    def _note(self, mode: Mode) -> None:
        reason = "" if self.modes is None else self.modes.reason
        if self._timeline.started_ns is None:
            reason = f"it was never armed: {reason}"
        self.trip = self.trip or Trip(self._cycle * self._period_s, str(mode), reason)
