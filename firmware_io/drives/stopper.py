# SPDX-License-Identifier: MIT
"""What the guard must know of a drive family: what its frames mean to it, and which frames stop the drives."""

import enum
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from segway_ecc.firmware_io.links.link import Frame


@enum.unique
class Meaning(enum.StrEnum):
    """What a frame means to the guard; the first three come from the node, the others from a drive."""

    MOVE = enum.auto()
    """A command that enables, or that carries a torque."""
    ZERO = enum.auto()
    """A command that carries no torque, and leaves the drive as it is."""
    DISABLE = enum.auto()
    """A command that switches the motor off; a zero too, for drives that know no more."""
    ON = enum.auto()
    """The drive reports that its motor follows commands."""
    OFF = enum.auto()
    """The drive reports that it does not."""


class Observation(NamedTuple):
    """What a frame means for a drive."""

    drive: str
    meaning: Meaning


class Stopper(Protocol):
    """A drive family as the guard knows it.

    Its drives are what can be commanded by itself: `board`, or each axis by its name; `reports` is whether they report
    if they are on.
    """

    drives: Sequence[str]
    reports: bool

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; None for one that is not intact or means nothing to the guard. Never raises."""

    def stop(self) -> Sequence[Frame]:
        """The frames that take the torque from every drive and disable it, of which the first that arrives acts."""


class WheelStopper:
    """A drive for each axis, which the same frames stop each time; see `Stopper`."""

    reports = True

    def __init__(self, names: Mapping[int, str], stop: Sequence[Frame]) -> None:
        """Know the axes by a number in their frames, and what stops them."""
        self.drives: Sequence[str] = tuple(names.values())
        self._names = names
        self._stop = stop

    def stop(self) -> Sequence[Frame]:
        """The frames for all; see `Stopper.stop`."""
        return self._stop
