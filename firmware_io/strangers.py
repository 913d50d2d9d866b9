# SPDX-License-Identifier: MIT
"""Frames of others that command our drives: another controller on the bus, or a recording that is played there."""

from collections import Counter
from collections.abc import Collection
from typing import Final

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.links.link import Frame, NowNs

RECENT_NS: Final = 1_000_000_000
"""For so long after the last of them the robot may not arm."""
_NAMED: Final = 4
_CLOSING: Final = "another controller commands this robot's drives, or a recording is played; find it and stop it"


class Strangers:
    """Counts such frames, `total` since the start, and names them."""

    def __init__(self, ours: Collection[FrameKey], now_ns: NowNs) -> None:
        """Know the frames that only we may send."""
        self.total = 0
        self._ours = frozenset(ours)
        self._now_ns = now_ns
        self._new: Counter[FrameKey] = Counter()
        self._newest_ns: int | None = None

    def take_frame(self, frame: Frame) -> None:
        """Take a frame that none of our devices listens to."""
        key = FrameKey(frame.arbitration_id, frame.is_extended)
        if key in self._ours:
            self._new[key] += 1
            self.total += 1
            self._newest_ns = self._now_ns()

    def report(self) -> str:
        """Name those that came since the last report; empty where none did."""
        if not self._new:
            return ""
        named = [f"0x{key.arbitration_id:X} ({count})" for key, count in sorted(self._new.items())[:_NAMED]]
        self._new.clear()
        return f"command frames that this node did not send, {', '.join(named)}: {_CLOSING}"

    @property
    def is_recent(self) -> bool:
        """Whether one came within the last second."""
        return self._newest_ns is not None and self._now_ns() - self._newest_ns < RECENT_NS
