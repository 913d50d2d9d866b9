# SPDX-License-Identifier: MIT
"""What a robot that balances is doing, by its tilt, its mode and what is asked of it; its model has no say in it."""

import enum
from typing import Final, NamedTuple

from segway_ecc.node.safety.check import periods_in
from segway_ecc.node.safety.settings import PostureSettings

_UP_FOR_S: Final = 0.1
"""How long it must be upright to be up, s."""
LIES_FOR_S: Final = 0.3
"""How long it must be still, off upright, to have come to rest, s."""


@enum.unique
class Posture(enum.StrEnum):
    """What the robot is doing."""

    RESTING = "RESTING"
    """It lies, or is held; no torque, also while it is armed."""
    STANDING_UP = "STANDING UP"
    """On its way from there to balance."""
    BALANCING = "BALANCING"
    """Up: it falls where torque ends."""
    SITTING_DOWN = "SITTING DOWN"
    """On its way down, under control."""
    FALLEN = "FALLEN"
    """It fell, did not get up or down in time, or lost its torque meanwhile: no torque, until it is asked to stand up,
    armed again, or its fault is cleared."""


UP: Final = frozenset({Posture.STANDING_UP, Posture.BALANCING})
"""Where it is up, or on its way."""


class Body(NamedTuple):
    """What is measured of the robot in a cycle.

    Attributes:
        tilt: From upright, rad; None while it is not known.
        is_still: Whether neither body nor wheels have moved for `LIES_FOR_S`.
        periods: How many periods have passed since the last cycle.
    """

    tilt: float | None
    is_still: bool
    periods: int = 1


class PostureWatch:
    """The state machine.

    Attributes:
        posture: What the robot is doing.
        reason: Why it has FALLEN; else empty.
    """

    def __init__(self, settings: PostureSettings, period_s: float) -> None:
        """Begin at rest; `look` is called once per period, s."""
        self.posture = Posture.RESTING
        self.reason = ""
        self._settings = settings
        self._up_for = periods_in(_UP_FOR_S, period_s)
        self._fall = periods_in(settings.fall_s, period_s)
        self._stand_up = periods_in(settings.stand_up_s, period_s)
        self._sit_down = periods_in(settings.sit_down_s, period_s)
        self._elapsed = 0
        self._lasting = 0

    def look(self, body: Body, *, active: bool, wants_up: bool) -> str | None:
        """Take a cycle.

        Args:
            body: What is measured in it.
            active: Whether commands reach the motors.
            wants_up: Whether the robot is to stand.

        Returns:
            The fault, where it has fallen in this cycle.
        """
        if not active:
            return None
        self._elapsed += body.periods
        match self.posture:
            case Posture.BALANCING:  # for nearly all of its time, and so asked for first
                return self._balancing(body, wants_up=wants_up)
            case Posture.STANDING_UP:
                return self._standing_up(body, wants_up=wants_up)
            case Posture.SITTING_DOWN:
                return self._sitting_down(body)
            case Posture.FALLEN:  # armed again
                self._enter(Posture.RESTING)
        if wants_up:
            self._enter(Posture.STANDING_UP)
        return None

    def lose_torque(self, body: Body, reason: str) -> None:
        """Take note that no command reaches the motors: a robot that does not lie falls."""
        if self.posture in {Posture.RESTING, Posture.FALLEN}:
            return
        if self._lies(body):
            self._enter(Posture.RESTING)
        else:
            self._enter(Posture.FALLEN, reason)

    def clear(self) -> None:
        """Forget a fall, as the fault was cleared or the robot is armed again."""
        if self.posture is Posture.FALLEN:
            self._enter(Posture.RESTING)

    def _balancing(self, body: Body, *, wants_up: bool) -> str | None:
        settings = self._settings
        if not wants_up:
            self._enter(Posture.SITTING_DOWN)
            return None
        if body.tilt is None:
            return None
        self._lasting = self._lasting + body.periods if body.tilt > settings.down_rad else 0
        if self._lasting < self._fall:
            return None
        return self._fall_down(
            f"the robot has fallen: it leans {body.tilt:.2f} rad, beyond {settings.down_rad:g} rad for "
            f"{settings.fall_s:g} s"
        )

    def _standing_up(self, body: Body, *, wants_up: bool) -> str | None:
        settings = self._settings
        if not wants_up:
            self._enter(Posture.SITTING_DOWN)
            return None
        is_up = body.tilt is not None and body.tilt <= settings.up_rad
        self._lasting = self._lasting + body.periods if is_up else 0
        if self._lasting >= self._up_for:
            self._enter(Posture.BALANCING)
        elif self._elapsed > self._stand_up:
            return self._fall_down(f"the robot did not stand up within {settings.stand_up_s:g} s")
        return None

    def _sitting_down(self, body: Body) -> str | None:
        if self._lies(body):
            self._enter(Posture.RESTING)
        elif self._elapsed > self._sit_down:
            return self._fall_down(f"the robot did not sit down within {self._settings.sit_down_s:g} s")
        return None

    def _lies(self, body: Body) -> bool:
        return body.is_still and body.tilt is not None and body.tilt > self._settings.up_rad

    def _fall_down(self, reason: str) -> str:
        self._enter(Posture.FALLEN, reason)
        return reason

    def _enter(self, posture: Posture, reason: str = "") -> None:
        self.posture, self.reason = posture, reason
        self._elapsed = self._lasting = 0
