# SPDX-License-Identifier: MIT
"""The base station in lock step: it sends set-points as they come due, over a link that may fail."""

import math
from collections.abc import Iterator, Sequence
from typing import Final

from segway_ecc.hil.faults.injection import Injection, Injections
from segway_ecc.node.cycle.interfaces import Inbox, NoStage, Report, StampedSetpoint
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, schedule

_NOT_NUMBERS: Final = (Setpoint(math.nan, math.nan), Setpoint(math.inf, -math.inf))


class Commander(NoStage):
    """Sends the set-points of a manoeuvre from when the robot is armed on, unstamped, and ends with it; see `Stage`."""

    def __init__(self, manoeuvre: Manoeuvre, injections: Injections) -> None:
        """Play a manoeuvre on the timeline of the faults."""
        self._timeline = injections.timeline
        self._injections = injections.of("command_link")
        self._duration_ns = manoeuvre.duration_ns
        self._pending = list(schedule(manoeuvre))
        self._last = REST
        self._on_the_way: list[tuple[int, Setpoint]] = []

    def publish(self, _report: Report) -> None:
        """Check whether the manoeuvre is over."""
        if self._timeline.elapsed_ns >= self._duration_ns:
            self.over = "the manoeuvre is over"

    def take_inbox(self) -> Inbox:
        """The set-points that arrive now."""
        inbox, elapsed_ns = Inbox(), self._timeline.elapsed_ns
        active = [injection for injection in self._injections if injection.is_active]
        while self._pending and self._pending[0].offset_ns <= elapsed_ns:
            sent = self._pending.pop(0)
            delay_s = sum(i.fault.size or 0.0 for i in active if i.fault.type == "delayed")
            self._on_the_way.append((elapsed_ns + round(delay_s * 1e9), sent.setpoint))
        arrived = [setpoint for due_ns, setpoint in self._on_the_way if due_ns <= elapsed_ns]
        self._on_the_way = [entry for entry in self._on_the_way if entry[0] > elapsed_ns]
        inbox.setpoints += [StampedSetpoint(setpoint, None) for setpoint in self._disturbed(arrived, active)]
        return inbox

    def _disturbed(self, arrived: Sequence[Setpoint], active: Sequence[Injection]) -> Iterator[Setpoint]:
        by_type = {injection.fault.type: injection for injection in active}
        for place, setpoint in enumerate(arrived):
            if "off" in by_type or ("intermittent" in by_type and by_type["intermittent"].happens()):
                continue
            self._last = setpoint
            if "garbage" in by_type:
                yield _NOT_NUMBERS[place % 2]
            elif "wrong" in by_type:
                ahead = by_type["wrong"].fault.size or 0.0
                yield setpoint._replace(linear_velocity=setpoint.linear_velocity + ahead)
            else:
                yield setpoint
        if "stuck" in by_type:
            yield from [self._last] * round(by_type["stuck"].fault.size or 0.0)
