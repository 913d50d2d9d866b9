# SPDX-License-Identifier: MIT
"""The name of a run's log, and what it tells."""

import datetime as dt
import re
from typing import Final

_RUNS_LOG: Final = re.compile(r"(.+)-[0-9]{8}T[0-9]{6}Z-[0-9]+(?:[^0-9].*)?", re.DOTALL)
"""As `name_of_log` makes it, with what may follow: the number of a later file, and what the file is."""


def name_of_log(robot: str, begun: dt.datetime, pid: int) -> str:
    """The name of the log of a robot's run that began then, UTC, in this process."""
    return f"{robot}-{begun.strftime('%Y%m%dT%H%M%SZ')}-{pid}.mcap"


def robot_of_log(name: str) -> str | None:
    """The name of the robot that a run's log is of; None where somebody named the log by hand."""
    match = _RUNS_LOG.fullmatch(name)
    return None if match is None else match[1]
