"""What the wheel board can take, and when what it sends is too old."""

from typing import Final

from firmware_io.drives.wheel_board.frames import CYCLE_TIME_S, FrameId

COMMAND_LIMITS: Final = {"left.voltage": 30.0, "right.voltage": 30.0}
"""Largest magnitude of each command, V."""

STALE_PERIODS: Final = 3
"""A value older than this many of its own periods, or of the loop's if those are longer, is not valid."""

WATCHDOG_ALLOWED_S: Final = (0.02, 0.05)
"""Range of the board's watchdog that the robot may be armed with."""


def stale_after_ns(frame_id: FrameId, loop_period_s: float) -> int:
    """Age above which a value from this frame is not valid, ns."""
    return round(STALE_PERIODS * max(CYCLE_TIME_S[frame_id], loop_period_s) * 1e9)
