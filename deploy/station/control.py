# SPDX-License-Identifier: MIT
"""Which operator has control of which robot. Pure."""

from typing import Final

from segway_ecc.deploy.station.events import EventLog
from segway_ecc.deploy.station.views import Act

_GIVES_CONTROL: Final = frozenset({Act.ARM, Act.PLAY, Act.STAND, Act.SIT})
_NEEDS_NONE: Final = frozenset({Act.STOP, Act.TAKE_CONTROL, Act.RELEASE_CONTROL})


class Control:
    """One operator at most has control of a robot."""

    def __init__(self, events: EventLog) -> None:
        """Begin with no robot controlled by anybody; log changes to `events`."""
        self._events = events
        self._who: dict[str, str] = {}

    def of(self, robot: str) -> str:
        """Who has control of it; empty for nobody."""
        return self._who.get(robot, "")

    def refusal(self, robot: str, who: str, act: Act) -> str | None:
        """Why `who` may not do this, or None; where nobody has control, a command that moves a robot gives it."""
        holder = self.of(robot)
        if act in _NEEDS_NONE or holder == who:
            return None
        if holder:
            return f"{holder} has control; take it first"
        if act in _GIVES_CONTROL:
            self.give(robot, who)
        return None

    def may_drive(self, robot: str, who: str) -> bool:
        """Whether `who` may drive; where nobody has control, driving gives it."""
        if not self.of(robot):
            self.give(robot, who)
        return self.of(robot) == who

    def give(self, robot: str, who: str) -> str:
        """Give control to `who`; return who had it."""
        before = self.of(robot)
        if before != who:
            self._who[robot] = who
            text = f"{who} took control from {before}" if before else f"{who} has control"
            self._events.add(robot, text, level="warning" if before else "info", who=who)
        return before

    def release(self, robot: str, who: str) -> bool:
        """Take control from `who`; False where they did not have it."""
        if self.of(robot) != who:
            return False
        del self._who[robot]
        self._events.add(robot, f"{who} gave up control", who=who)
        return True

    def robots_of(self, who: str) -> list[str]:
        """The robots that `who` has control of."""
        return [robot for robot, holder in self._who.items() if holder == who]
