# SPDX-License-Identifier: MIT
"""The base station that watches over the robot: what its silence means, by the robot's own decision."""

import enum
from collections.abc import Sequence

from segway_ecc.node.errors import UnknownNameError
from segway_ecc.node.safety.settings import StationSettings


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
    """Counts the cycles since a heartbeat.

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
        """Take note of a cycle.

        Args:
            cycle: Its number.
            has_heartbeat: Whether a heartbeat, of any station, came in it.
            is_live: Whether the robot is armed, or on the way there.
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
