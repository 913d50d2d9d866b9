# SPDX-License-Identifier: MIT
"""Where the three parts of control run, and which flows then cross the network."""

import enum
import itertools
from typing import Final, NamedTuple


@enum.unique
class Site(enum.StrEnum):
    """One end of the network."""

    ROBOT = "robot"
    STATION = "station"


class Placement(NamedTuple):
    """Where each part runs. Drives, their watchdogs, sensors and the guard are on the robot.

    Attributes:
        sequence: Sequence control: who sends set-points.
        balance: Balance control: the model node.
        supervision: Supervision: heartbeats, and the stop button.
    """

    sequence: Site
    balance: Site
    supervision: Site

    @property
    def sequence_crosses(self) -> bool:
        """Whether set-points cross the network to the model node."""
        return self.sequence is not self.balance

    @property
    def balance_crosses(self) -> bool:
        """Whether what is measured, and the commands, cross the network."""
        return self.balance is Site.STATION

    @property
    def supervision_crosses(self) -> bool:
        """Whether heartbeats and the stop cross the network to the model node."""
        return self.supervision is not self.balance

    @property
    def at_station(self) -> int:
        """How many of the three are on the base station."""
        return sum(place is Site.STATION for place in self)

    def __str__(self) -> str:
        """What is on the station, in words."""
        away = [name for name, place in zip(self._fields, self, strict=True) if place is Site.STATION]
        return f"{' and '.join(away)} on the station" if away else "all on the robot"


PLACEMENTS: Final = tuple(itertools.starmap(Placement, itertools.product(Site, repeat=3)))
"""All there are; the first has everything on the robot."""
ON_THE_ROBOT: Final = PLACEMENTS[0]
