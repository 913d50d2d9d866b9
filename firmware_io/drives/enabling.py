# SPDX-License-Identifier: MIT
"""What the drives share: the phases on the way to torque, disable feedback, and the signals of a wheel."""

import enum
from typing import Final

from mypy_extensions import mypyc_attr

from segway_ecc.firmware_io.links.link import NowNs

ENABLE_WITHIN_NS: Final = 500_000_000
"""A drive that has not confirmed by then has failed to enable."""


def wheel_signals(name: str) -> dict[str, str]:
    """What a drive measures of the wheel `name`, with units."""
    return {f"{name}.angle": "rad", f"{name}.velocity": "rad/s", f"{name}.torque": "N m"}


@enum.unique
class Phase(enum.StrEnum):
    """What the host wants of a drive, and whether it has it."""

    OFF = "off"
    ENABLING = "enabling"
    ENABLED = "enabled"


class Enabling:
    """Where a drive is on the way from off to enabled."""

    __slots__ = ("_begun_ns", "_disabled_ns", "phase")

    def __init__(self) -> None:
        self.phase = Phase.OFF
        self._begun_ns = 0
        self._disabled_ns = -1

    def begin(self, now_ns: int) -> None:
        """The drive is commanded to enable."""
        self.phase = Phase.ENABLING
        self._begun_ns = now_ns

    def confirm(self) -> None:
        """The drive has confirmed; without effect unless it was commanded to enable."""
        if self.phase is Phase.ENABLING:
            self.phase = Phase.ENABLED

    def retract(self, now_ns: int, within_ns: int) -> None:
        """Take back the confirmation of a command that is no older than `within_ns`: it was sent before the command."""
        if self.phase is Phase.ENABLED and now_ns - self._begun_ns <= within_ns:
            self.phase = Phase.ENABLING

    def end(self, now_ns: int) -> None:
        """The drive is commanded to switch off; a drive that is off already keeps its disable feedback."""
        if self.phase is not Phase.OFF:
            self._disabled_ns = now_ns
        self.phase = Phase.OFF

    def is_overdue(self, now_ns: int) -> bool:
        """Whether the drive was asked too long ago and has not confirmed."""
        return self.phase is Phase.ENABLING and now_ns - self._begun_ns > ENABLE_WITHIN_NS

    def confirms_disable(self, off_ns: int | None) -> bool:
        """Disable feedback: whether the drive has reported its disabled state since the last command to disable.

        Args:
            off_ns: When the newest report arrived, if it shows the motor off; else None. What had arrived by the time
                of the command does not count, also where it is read later. Whether it is fresh is for the caller.
        """
        return off_ns is not None and off_ns > self._disabled_ns


@mypyc_attr(allow_interpreted_subclasses=True)  # where this is compiled, drives in plain Python still build on it
class PhasedDrive:
    """What the drives share: the phases that they pass through, and the clock of the loop; see `Drive`."""

    def __init__(self, now_ns: NowNs) -> None:
        """Begin switched off."""
        self._now_ns = now_ns
        self._enabling = Enabling()
        self._off_ns: int | None = None
        """When the newest report arrived, if it shows the motor off; else None."""

    @property
    def is_enabled(self) -> bool:
        """Whether the drive has confirmed that its motors follow commands."""
        return self._enabling.phase is Phase.ENABLED
