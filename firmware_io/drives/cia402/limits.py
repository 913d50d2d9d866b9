# SPDX-License-Identifier: MIT
"""What the host asks of a CiA 402 drive, and how long it waits."""

from typing import Final

WATCHDOG_ALLOWED_MS: Final = (20, 50)
"""Range of the drive's consumer heartbeat time (0x1016) that the robot may be armed with, ms."""
HEARTBEAT_PERIOD_MS: Final = 20
"""The drive's producer heartbeat time (0x1017), ms."""
SUPPLY_PERIOD_US: Final = 100_000
"""How often the drive sends the voltage of its supply, as near as a count of SYNCs comes, us."""
MAX_SYNCS: Final = 240
"""The most SYNCs that a PDO can be sent every so many of (CiA 301, transmission type)."""
BOOT_WITHIN_NS: Final = 5_000_000_000
"""After the order to start anew, a drive that has not reported by then is not there."""
SETTLE_NS: Final = 100_000_000
"""After all drives have reported."""
ANSWER_WITHIN_NS: Final = 300_000_000
"""An SDO request that is not answered by then has failed."""
