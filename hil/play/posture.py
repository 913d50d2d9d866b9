# SPDX-License-Identifier: MIT
"""A robot that stands up and sits down on request: its phase, and the requests."""

from collections import deque
from typing import Final

from segway_ecc.node.cycle.interfaces import SetValue
from segway_ecc.node.models.segway_phases import Phase
from segway_ecc.node.robot import Robot

STAND: Final = "stand"
"""The value that anybody may set: 1 stand, 0 sit."""
PHASE: Final = "Phase"
"""The model's output of what it is doing, a `Phase`."""
_UP: Final = frozenset({Phase.STANDING_UP, Phase.BALANCING})


class Posture:
    """Has the robot stand up or sit down; see `segway_ecc.node.models.segway_phases`.

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
