# SPDX-License-Identifier: MIT
"""What a person can do but drive: push the plant, break its bus, have the robot stand up and sit down."""

import os
from collections import deque
from collections.abc import Callable
from typing import Final

from segway_ecc.node.cycle.interfaces import SetValue
from segway_ecc.node.models.segway_law import Phase
from segway_ecc.node.robot import Robot

PUSH_N: Final = 50.0
PUSH_S: Final = 0.1
"""With `PUSH_N` 5 N s: the segway of the case study recovers from 7.5 N s at rest."""
FORCE: Final = "PushForce"
STAND: Final = "stand"
"""The value that anybody may set: 1 stand, 0 sit."""
PHASE: Final = "Phase"
"""The model's output of what it is doing, a `Phase`."""
_UP: Final = frozenset({Phase.STANDING_UP, Phase.BALANCING})


class PlantControls:
    """Sends commands to the plant's process, without waiting for it."""

    def __init__(
        self,
        control: int,
        period_ns: int,
        guard_runs: Callable[[], bool],
        *,
        has_ros: bool = False,
        can_be_pushed: bool,
    ) -> None:
        """Write to the plant's control, a descriptor; `work` is called once in `period_ns`."""
        self.has_ros = has_ros
        self.guard_runs = guard_runs
        self.can_be_pushed = can_be_pushed
        self.is_bus_broken = False
        self._control = control
        self._push_cycles = max(round(PUSH_S * 1e9 / period_ns), 1)
        self._left = 0
        os.set_blocking(control, False)

    def push(self) -> None:
        """Push the robot ahead for a moment, where it can be pushed."""
        if self.can_be_pushed and self._send(f"write {FORCE} {PUSH_N}"):
            self._left = self._push_cycles

    def toggle_bus(self) -> None:
        """Cut the bus; or restore it, where it was cut."""
        if self._send("heal" if self.is_bus_broken else "cut"):
            self.is_bus_broken = not self.is_bus_broken

    def work(self) -> None:
        """End a push whose time is over."""
        if self._left == 1 and not self._send(f"write {FORCE} 0"):
            return
        self._left = max(self._left - 1, 0)

    def _send(self, line: str) -> bool:
        try:
            return os.write(self._control, f"{line}\n".encode()) > 0
        except OSError:  # full, or the plant is gone
            return False


class Posture:
    """Has the robot stand up or sit down; see `segway_ecc.node.models.segway_law`.

    Attributes:
        can_change: Whether the robot is one that stands up and sits down.
    """

    def __init__(self, robot: Robot) -> None:
        """Look at how a robot is wired."""
        self.can_change = STAND in robot.wiring.set_names and PHASE in [v.name for v in robot.model.outputs]
        self._place = robot.wiring.set_names.index(STAND) if self.can_change else 0
        self._model = robot.model
        self._pending: deque[float] = deque()

    @property
    def doing(self) -> str | None:
        """What the robot is doing, in words; None where it has no phases."""
        return self._phase.name.lower().replace("_", " ") if self.can_change else None

    def change(self) -> None:
        """Sit down where it is up, and stand up where it is down: one that gave up has to sit first."""
        self._pending = deque((0.0,) if self._phase in _UP else (0.0, 1.0))

    def take_requests(self) -> list[SetValue]:
        """The request of this cycle: one value, since the second of two would be all that the model sees."""
        return [SetValue(self._place, self._pending.popleft())] if self._pending else []

    @property
    def _phase(self) -> Phase:
        return Phase(int(self._model.read(PHASE)))
