# SPDX-License-Identifier: MIT
"""The modes of the robot and what leads from one to another."""

import enum
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

STATION_LOST: Final = "the base station is lost"
"""Why the robot holds, and in the end disarms, when nobody watches over it any more."""
_TRANSITIONS_KEPT: Final = 64


@enum.unique
class Mode(enum.StrEnum):
    """What the robot is allowed to do."""

    DISARMED = "DISARMED"
    """Zero is sent; set-points are not taken."""
    ARMED = "ARMED"
    """Set-points are followed."""
    HOLD = "HOLD"
    """Set-points or the base station fell silent: the robot holds its place under control."""
    FAULT = "FAULT"
    """Zero is sent, until the fault is cleared."""


ACTIVE: Final = frozenset({Mode.ARMED, Mode.HOLD})
"""The modes in which commands reach the motors."""


@enum.unique
class Action(enum.StrEnum):
    """What an operator can ask for."""

    ARM = "arm"
    DISARM = "disarm"
    STOP = "stop"
    CLEAR_FAULT = "clear_fault"


@dataclass(frozen=True, slots=True)
class Answer:
    """What came of a request.

    Attributes:
        accepted: Whether it was done.
        message: What was done, or why not.
    """

    accepted: bool
    message: str


class Transition(NamedTuple):
    """A mode that was entered, in which cycle and why."""

    cycle: int
    mode: Mode
    reason: str


class Modes:
    """The state machine; every transition keeps its reason.

    What only loses guidance (silent set-points, a lost base station) leads to HOLD, since a robot that balances falls
    without torque; what makes control itself unsafe is a fault and takes the torque away.

    Attributes:
        mode: The present mode.
        reason: Why it was entered.
        cycle: The number of the present cycle; whoever runs the cycles sets it.
        history: The newest transitions, the oldest first.
    """

    def __init__(self) -> None:
        """Start disarmed."""
        self.mode = Mode.DISARMED
        self.reason = "just started"
        self.cycle = 0
        self.history: deque[Transition] = deque(maxlen=_TRANSITIONS_KEPT)

    def ask(self, action: Action, failures: Sequence[str] = ()) -> Answer:
        """Carry out a request, or refuse it with the reason.

        Args:
            action: What is asked.
            failures: What keeps it from arming; only looked at for `Action.ARM`.
        """
        match action:
            case Action.ARM:
                return self._arm(failures)
            case Action.DISARM:
                if self.mode is Mode.FAULT:
                    return Answer(accepted=True, message="the motors are off already, by a fault")
                return self._enter(Mode.DISARMED, "asked to disarm")
            case Action.STOP:
                return self._enter(Mode.FAULT, "stop was pressed")
            case Action.CLEAR_FAULT:  # pragma: no branch - there is no other action
                if self.mode is not Mode.FAULT:
                    return Answer(accepted=False, message=f"there is no fault to clear: the robot is {self.mode}")
                return self._enter(Mode.DISARMED, "fault cleared")

    def observe(self, faults: Sequence[str], *, setpoints_silent: bool, station_lost: bool = False) -> None:
        """Look at this cycle's faults, base station and set-points; the most severe wins."""
        if self.mode not in ACTIVE:
            return
        if faults:
            self._enter(Mode.FAULT, "; ".join(faults))
        elif station_lost:
            self._enter(Mode.HOLD, STATION_LOST)
        elif setpoints_silent and (self.mode is Mode.ARMED or self.reason == STATION_LOST):
            self._enter(Mode.HOLD, "no set-point arrives any more")
        elif not setpoints_silent and self.mode is Mode.HOLD:
            is_back = self.reason == STATION_LOST
            self._enter(Mode.ARMED, "the base station is back" if is_back else "set-points arrive again")

    def disarm(self, reason: str) -> None:
        """Leave an active mode by the robot's own decision."""
        if self.mode in ACTIVE:
            self._enter(Mode.DISARMED, reason)

    def fail(self, reason: str) -> None:
        """Enter FAULT at once, from any mode."""
        if self.mode is not Mode.FAULT:
            self._enter(Mode.FAULT, reason)

    def _arm(self, failures: Sequence[str]) -> Answer:
        if self.mode is Mode.FAULT:
            return Answer(accepted=False, message=f"clear the fault first: {self.reason}")
        if self.mode in ACTIVE:
            return Answer(accepted=True, message="armed already")
        if failures:
            return Answer(accepted=False, message="; ".join(failures))
        return self._enter(Mode.ARMED, "asked to arm")

    def _enter(self, mode: Mode, reason: str) -> Answer:
        if (mode, reason) != (self.mode, self.reason):
            self.history.append(Transition(self.cycle, mode, reason))
        self.mode = mode
        self.reason = reason
        return Answer(accepted=True, message=f"{mode}: {reason}")
