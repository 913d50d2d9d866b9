# SPDX-License-Identifier: MIT
"""Driving by hand: a set-point that is not renewed becomes zeros, then silence. Pure: time is given."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from segway_ecc.node.cycle.setpoints import REST, Setpoint

RENEWED_WITHIN_NS: Final = 300_000_000
ZEROS: Final = 5
"""Zeros that follow one another, so that not one of them has to arrive."""
ZERO_EVERY_NS: Final = 40_000_000


@dataclass(slots=True)
class _Driven:
    renewed_ns: int
    is_at_rest: bool = False
    zeros_left: int = ZEROS
    next_zero_ns: int = 0


class DeadMan:
    """The dead man's switch of whoever drives: brings a robot to rest whose set-point is released or not renewed."""

    def __init__(self) -> None:
        """Begin with no robot driven."""
        self._driven: dict[str, _Driven] = {}

    def drives(self, robot: str) -> bool:
        """Whether a robot is being driven, or zeros are still to follow."""
        return robot in self._driven

    def renew(self, robot: str, setpoint: Setpoint, at_ns: int) -> None:
        """A set-point was given and is sent now; zero ends the driving, and is followed by more zeros."""
        if setpoint == REST:
            self.release(robot, at_ns)
        else:
            self._driven[robot] = _Driven(at_ns)

    def release(self, robot: str, now_ns: int) -> None:
        """Begin with the zeros now, where it was driven."""
        driven = self._driven.get(robot)
        if driven is not None and not driven.is_at_rest:
            driven.is_at_rest, driven.next_zero_ns = True, now_ns

    def zeros_due(self, now_ns: int) -> Iterator[tuple[str, bool]]:
        """The robots that are to be sent zero now, each with whether its set-point ran out."""
        for robot, driven in list(self._driven.items()):
            ran_out = not driven.is_at_rest and now_ns - driven.renewed_ns > RENEWED_WITHIN_NS
            if ran_out:
                self.release(robot, now_ns)
            if not driven.is_at_rest or now_ns < driven.next_zero_ns:
                continue
            driven.zeros_left -= 1
            driven.next_zero_ns = now_ns + ZERO_EVERY_NS
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
