# SPDX-License-Identifier: MIT
"""What the VESC can take."""

from typing import Final

MAX_CURRENT: Final = 1_000.0
"""More motor current than any VESC gives, A; a robot file that asks for more is wrong."""

TIMEOUT_ALLOWED_S: Final = (0.02, 0.1)
"""Range of the controllers' time-out that the robot may be armed with; the firmware looks every 10 ms."""
