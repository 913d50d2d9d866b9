# SPDX-License-Identifier: MIT
"""The base station of a run in lock step."""

import math
from collections.abc import Iterator, Sequence
from typing import Final

from segway_ecc.hil.faults.fault import Injection, Injections, active
from segway_ecc.hil.faults.models import AmissValues
from segway_ecc.node.cycle.interfaces import Inbox, NoStage, Request, StampedSetpoint, VariableWrite
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.safety.modes import Action, Answer
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, schedule

_ASKS: Final = {"off": (Action.STOP,), "wrong": (Action.DISARM,), "stuck": (Action.CLEAR_FAULT, Action.ARM)}
"""What an operator asks, by the type of the fault."""
_NOT_NUMBERS: Final = (Setpoint(math.nan, math.nan), Setpoint(math.inf, -math.inf))


class Commander(NoStage):
    """The base station: it sends the set-points of a manoeuvre, unstamped, over a link that may fail; see `Stage`.

    It begins when the robot is armed, and ends with the manoeuvre. `refusals` has why what was asked was refused, each
    reason once.
    """

    def __init__(self, manoeuvre: Manoeuvre, injections: Injections, set_names: Sequence[str] = ()) -> None:
        """Play a manoeuvre on the timeline of the faults, to a robot with values of these names to be set."""
        self._amiss = AmissValues(injections, set_names)
        self._timeline = injections.timeline
        self._injections = injections.of("command_link")
        self._duration_ns = manoeuvre.duration_ns
        self._pending = list(schedule(manoeuvre))
        self._last = REST
        self._on_the_way: list[tuple[int, Setpoint]] = []
        self._asks = injections.of("operator")
        self._writes = injections.of("parameter")
        self._is_lost = injections.of("ros")
        self.refusals: dict[str, None] = {}

    def take_inbox(self) -> Inbox:
        """The set-points that arrive now; and check whether the manoeuvre is over."""
        inbox, elapsed_ns = Inbox(values=self._amiss.take()), self._timeline.elapsed_ns
        if elapsed_ns >= self._duration_ns:
            self.over = "the manoeuvre is over"
        faults = active(self._injections)
        while self._pending and self._pending[0].offset_ns <= elapsed_ns:
            sent = self._pending.pop(0)
            delay_s = sum(i.size for i in faults if i.fault.type == "delayed")
            self._on_the_way.append((elapsed_ns + round(delay_s * 1e9), sent.setpoint))
        arrived: list[Setpoint] = []
        if self._on_the_way:
            arrived = [setpoint for due_ns, setpoint in self._on_the_way if due_ns <= elapsed_ns]
            self._on_the_way = [entry for entry in self._on_the_way if entry[0] > elapsed_ns]
        if active(self._is_lost):
            return inbox
        inbox.setpoints += [StampedSetpoint(setpoint, None) for setpoint in self._disturbed(arrived, faults)]
        for injection in active(self._asks):
            inbox.requests += [Request(action, self._note) for action in _ASKS[injection.fault.type]]
        for injection in active(self._writes):
            name = injection.fault.name or ""
            inbox.writes.append(VariableWrite([(name, injection.size)], self._note_refusal))
        return inbox

    def _note(self, answer: Answer) -> None:
        if not answer.accepted:
            self._note_refusal(answer.message)

    def _note_refusal(self, reason: str) -> None:
        if reason:
            self.refusals[reason] = None

    def _disturbed(self, arrived: Sequence[Setpoint], faults: Sequence[Injection]) -> Iterator[Setpoint]:
        by_type = {injection.fault.type: injection for injection in faults}
        for place, setpoint in enumerate(arrived):
            if "off" in by_type or ("intermittent" in by_type and by_type["intermittent"].happens()):
                continue
            self._last = setpoint
            if "garbage" in by_type:
                yield _NOT_NUMBERS[place % 2]
            elif "wrong" in by_type:
                ahead = by_type["wrong"].size
                yield setpoint._replace(linear_velocity=setpoint.linear_velocity + ahead)
            else:
                yield setpoint
        if "stuck" in by_type:
            yield from [self._last] * round(by_type["stuck"].size)
