# SPDX-License-Identifier: MIT
"""The modes of the robot and what leads from one to another, a base station that falls silent too."""

import enum
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from segway_ecc.node.errors import UnknownNameError
from segway_ecc.node.safety.settings import StationSettings

STATION_LOST: Final = "the base station is lost"
"""Why the robot holds, and in the end disarms, when nobody watches over it any more."""
STOPPED: Final = "stop was pressed"
"""Why the robot is in FAULT when an operator has put it there."""
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
    STAND_UP = "stand_up"
    SIT_DOWN = "sit_down"


POSTURES: Final = frozenset({Action.STAND_UP, Action.SIT_DOWN})
"""What is asked only of a robot whose file has a posture."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What came of a request: whether it was done, and what was done, or why not."""

    accepted: bool
    message: str


class Transition(NamedTuple):
    """A mode that was entered, in which cycle and why."""

    cycle: int
    mode: Mode
    reason: str


def refused(reasons: Sequence[str]) -> Answer:
    """No, for these reasons."""
    return Answer(accepted=False, message="; ".join(reasons))


class Modes:
    """The state machine; every transition keeps its reason.

    What only loses guidance (silent set-points, a lost base station) leads to HOLD, since a robot that balances falls
    without torque; what makes control itself unsafe is a fault and takes the torque away.

    Attributes:
        reason: Why the present mode was entered.
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
        """Carry out a request, or refuse it with the reason; to arm, those are the `failures`."""
        match action:
            case Action.ARM:
                return self._arm(failures)
            case Action.DISARM:
                if self.mode is Mode.FAULT:
                    return Answer(accepted=True, message="the motors are off already, by a fault")
                return self._enter(Mode.DISARMED, "asked to disarm")
            case Action.STOP:
                return self._enter(Mode.FAULT, STOPPED)
            case Action.CLEAR_FAULT:
                return self._clear_fault()
            case Action.STAND_UP | Action.SIT_DOWN:  # pragma: no branch - there is no other action
                return Answer(accepted=False, message="this robot neither stands up nor sits down on request")

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
            return refused(failures)
        return self._enter(Mode.ARMED, "asked to arm")

    def _clear_fault(self) -> Answer:
        if self.mode is not Mode.FAULT:
            return Answer(accepted=False, message=f"there is no fault to clear: the robot is {self.mode}")
        return self._enter(Mode.DISARMED, "fault cleared")

    def _enter(self, mode: Mode, reason: str) -> Answer:
        if (mode, reason) != (self.mode, self.reason):
            self.history.append(Transition(self.cycle, mode, reason))
        self.mode = mode
        self.reason = reason
        return Answer(accepted=True, message=f"{mode}: {reason}")


@enum.unique
class Watch(enum.IntEnum):
    """How the base station stands to the robot; a greater one holds all that a lesser one does."""

    ALONE = enum.auto()
    """No base station watches over the robot: nothing follows from silence."""
    PRESENT = enum.auto()
    """One does, and sent a heartbeat lately."""
    LOST = enum.auto()
    """It fell silent: the robot holds."""
    SIT_DOWN = enum.auto()
    """It has been silent for long: the robot sits down."""
    DISARM = enum.auto()
    """It has been silent for so long that the motors go off."""


class StationWatch:
    """Counts the cycles since a heartbeat of a station that was introduced.

    A station whose heartbeat came within the time-out before the robot armed, or at any time since, watches over it
    until it is disarmed. A robot that nobody watches over runs alone.
    """

    def __init__(self, settings: StationSettings | None, period_ns: int) -> None:
        """Watch by the robot file's settings; None watches nothing."""
        self._steps: tuple[tuple[int, Watch], ...] = ()
        if settings is not None:
            steps = (
                (settings.timeout_s, Watch.LOST),
                (settings.sit_down_after_s, Watch.SIT_DOWN),
                (settings.disarm_after_s, Watch.DISARM),
            )
            self._steps = tuple((round(after_s * 1e9 / period_ns), what) for after_s, what in steps if after_s)
        self._beat_at: int | None = None

    def look(self, cycle: int, *, has_heartbeat: bool, is_live: bool) -> Watch:
        """Take note of a cycle, by its number, in which such a heartbeat came or did not.

        The robot `is_live` where it is armed, or on the way there.
        """
        if not self._steps:
            return Watch.ALONE
        if has_heartbeat:
            self._beat_at = cycle
        if self._beat_at is None:
            return Watch.ALONE
        silent_for, watch = cycle - self._beat_at, Watch.PRESENT
        for after, what in self._steps:
            if silent_for <= after:
                break
            watch = what
        if watch is not Watch.PRESENT and not is_live:
            self._beat_at = None
            return Watch.ALONE
        return watch


def sit_down_values(settings: StationSettings | None, set_names: Sequence[str]) -> tuple[tuple[int, float], ...]:
    """What sitting down sets: the place among `set_names`, and the value.

    Raises:
        UnknownNameError: The robot has no such value.
    """
    if settings is None:
        return ()
    for name in settings.sit_down:
        if name not in set_names:
            raise UnknownNameError("value of station.sit_down that is wired as set.<name>", name, set_names)
    return tuple((set_names.index(name), value) for name, value in settings.sit_down.items())
