"""The phases that every drive passes through on the way to torque."""

import enum
from typing import Final

ENABLE_WITHIN_NS: Final = 500_000_000
"""A drive that has not confirmed by then has failed to enable."""


@enum.unique
class Phase(enum.StrEnum):
    """What the host wants of a drive, and whether it has it."""

    OFF = "off"
    ENABLING = "enabling"
    ENABLED = "enabled"


class Enabling:
    """Where a drive is on the way from off to enabled.

    Attributes:
        phase: The present phase.
    """

    __slots__ = ("_begun_ns", "phase")

    def __init__(self) -> None:
        self.phase = Phase.OFF
        self._begun_ns = 0

    def begin(self, now_ns: int) -> None:
        """The drive is asked to enable."""
        self.phase = Phase.ENABLING
        self._begun_ns = now_ns

    def confirm(self) -> None:
        """The drive has confirmed; means nothing unless it was asked."""
        if self.phase is Phase.ENABLING:
            self.phase = Phase.ENABLED

    def end(self) -> None:
        """The drive is told to switch off."""
        self.phase = Phase.OFF

    def is_overdue(self, now_ns: int) -> bool:
        """Whether the drive was asked too long ago and has not confirmed."""
        return self.phase is Phase.ENABLING and now_ns - self._begun_ns > ENABLE_WITHIN_NS
