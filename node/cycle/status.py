# SPDX-License-Identifier: MIT
"""One diagnostic status, as diagnostic_msgs/DiagnosticStatus has it (REP-107)."""

import enum
from collections.abc import Mapping
from dataclasses import dataclass


@enum.unique
class Level(enum.IntEnum):
    """How bad it is."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class DiagnosticStatus:
    """The state of one part of the robot: in a few words, and all that is known about it, as text."""

    level: Level
    name: str
    message: str
    values: Mapping[str, str]
