# SPDX-License-Identifier: MIT
"""What the wheel board can take."""

from typing import Final

COMMAND_LIMITS: Final = {"left.voltage": 30.0, "right.voltage": 30.0}
"""Largest magnitude of each command, V."""

WATCHDOG_ALLOWED_S: Final = (0.02, 0.05)
"""Range of the board's watchdog that the robot may be armed with."""
