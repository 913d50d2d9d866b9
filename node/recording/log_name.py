# SPDX-License-Identifier: MIT
"""What the name of a log tells."""

import re
from typing import Final

_RUNS_LOG: Final = re.compile(r"(.+)-[0-9]{8}T[0-9]{6}Z-[0-9]+(?:[^0-9].*)?", re.DOTALL)
"""As `node.cli.options.default_log` makes it."""


def robot_of_log(name: str) -> str | None:
    """The name of the robot that a run's log is of; None where somebody named the log by hand."""
    match = _RUNS_LOG.fullmatch(name)
    return None if match is None else match[1]
