# SPDX-License-Identifier: MIT
"""What a drive is set to, as it reported it: for who compares it with what the robot needs, and for a report.

What of it a drive offers is optional, so that it is no part of `Drive`: a family without it has nothing to add.
"""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.value import Value


class DriveReading(Value, frozen=True):
    """One setting or limit of a drive.

    Attributes:
        name: Wheel or board, what it is, and the unit: `left_most_current_a`.
        value: In that unit; 1 and 0 for on and off.
        unit: For people; empty for what has none.
    """

    name: str
    value: float
    unit: str = ""


@runtime_checkable
class ReportsSettings(Protocol):
    """A drive, or hardware made of drives, that reads back settings."""

    @property
    def readings(self) -> Sequence[DriveReading]:
        """What has been read back so far."""


@runtime_checkable
class StandbyListener(Protocol):
    """A drive whose settings a line in standby reads, which the line in use cannot."""

    def take_standby_frame(self, frame: Frame) -> None:
        """Take a frame that the line in standby brought: never a measurement that the robot is controlled by."""


def readings_of(part: object) -> Sequence[DriveReading]:
    """What a drive or hardware has read back; nothing where it reads nothing back."""
    return part.readings if isinstance(part, ReportsSettings) else ()
