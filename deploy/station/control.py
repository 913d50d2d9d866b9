# SPDX-License-Identifier: MIT
"""Which operator has control of which robot, and the dead man's switch of whoever drives. Pure: time is given."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from segway_ecc.deploy.station.fleet import EventLog
from segway_ecc.deploy.station.views import Act
from segway_ecc.node.cycle.setpoints import Setpoint

_GIVES_CONTROL: Final = frozenset({Act.ARM, Act.PLAY, Act.STAND, Act.SIT})
_NEEDS_NONE: Final = frozenset({Act.STOP, Act.TAKE_CONTROL, Act.RELEASE_CONTROL})
_RENEWED_WITHIN_NS: Final = 300_000_000
_ZEROS: Final = 5
"""Zeros that follow one another, so that not one of them has to arrive."""
_ZERO_EVERY_NS: Final = 40_000_000


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


@dataclass(slots=True)
class _Driven:
    renewed_ns: int
    is_at_rest: bool = False
    zeros_left: int = _ZEROS
    next_zero_ns: int = 0


class DeadMan:
    """The dead man's switch of whoever drives: brings a robot to rest whose set-point is released or not renewed."""

    def __init__(self) -> None:
        self._driven: dict[str, _Driven] = {}

    def drives(self, robot: str) -> bool:
        """Whether a robot is being driven, or zeros are still to follow."""
        return robot in self._driven

    def renew(self, robot: str, at_ns: int) -> None:
        """A set-point other than zero was given at `at_ns`, and is sent now."""
        self._driven[robot] = _Driven(at_ns)

    def release(self, robot: str, now_ns: int) -> None:
        """Begin with the zeros now, where it was driven."""
        driven = self._driven.get(robot)
        if driven is not None and not driven.is_at_rest:
            driven.is_at_rest, driven.next_zero_ns = True, now_ns

    def zeros_due(self, now_ns: int) -> Iterator[tuple[str, bool]]:
        """The robots that are to be sent zero now, each with whether its set-point ran out."""
        for robot, driven in list(self._driven.items()):
            ran_out = not driven.is_at_rest and now_ns - driven.renewed_ns > _RENEWED_WITHIN_NS
            if ran_out:
                self.release(robot, now_ns)
            if not driven.is_at_rest or now_ns < driven.next_zero_ns:
                continue
            driven.zeros_left -= 1
            driven.next_zero_ns = now_ns + _ZERO_EVERY_NS
            if not driven.zeros_left:
                del self._driven[robot]
            yield robot, ran_out


def fitted(linear: float, angular: float, limits: Setpoint) -> Setpoint | None:
    """A set-point (m/s, rad/s) clamped to limits; None where it is not finite."""
    if not (math.isfinite(linear) and math.isfinite(angular)):
        return None
    return Setpoint(
        min(max(linear, -limits.linear_velocity), limits.linear_velocity),
        min(max(angular, -limits.angular_velocity), limits.angular_velocity),
    )
