# SPDX-License-Identifier: MIT
"""The times that the driver keeps, what it tolerates, and whom it can address."""

from typing import Final

RESEND_NS: Final = 50_000_000
"""A step that the axis has not confirmed is sent again after this long."""

IN_FLIGHT_NS: Final = 5_000_000
"""What arrives this soon after a frame was sent may have been on its way before; a frame waits a few ms at the most."""

CLEAR_EVERY_NS: Final = 300_000_000
"""Shortest time between two attempts to see the watchdog expire; longer than any that may be set."""

ASK_EVERY_NS: Final = 100_000_000
"""How often the firmware is asked for its version while that is not known."""

ANSWERS_WITHIN_NS: Final = 350_000_000
"""A drive that was asked for its version this long, and sends heartbeats, is one that cannot answer: firmware 0.5."""

STEPS_BITS: Final = 4_000
"""What it takes on the serial line to disable both axes and enable them again: 380 bytes of ten bits."""

MAX_NODE_ID: Final = 62
"""Highest node that can be addressed; 63 is everybody's."""
