# SPDX-License-Identifier: MIT
"""How old the newest frame of each kind is, and whether that is fresh enough."""

import math
from collections.abc import Callable, Hashable, Mapping
from typing import Final, Generic, TypeVar

NowNs = Callable[[], int]
Kind = TypeVar("Kind", bound=Hashable)

STALE_PERIODS: Final = 3
"""A value older than this many of its own periods, or of the loop's if those are longer, is not valid."""
PATIENCE_PERIODS: Final = 5
"""Nor, while the device still sends other frames, one older than this many.

A bus that loses one frame in a hundred loses three in a row of one kind every hour, and of all kinds never. So a device
that is silent is known after three periods, and a healthy one is not cut off for the frames that were lost.
"""
SUPPLY_STALE_NS: Final = 1_000_000_000
"""The voltage of the supply is sent seldom and changes slowly: it is valid up to this age."""


def stale_after_ns(frame_period_s: float, loop_period_s: float) -> int:
    """Age above which a value from a frame that comes at this period is not valid, ns."""
    return round(STALE_PERIODS * max(frame_period_s, loop_period_s) * 1e9)


class Freshness(Generic[Kind]):
    """Remembers when each kind of frame of one device last arrived intact.

    Attributes:
        newest_ns: When the newest of them all arrived; None before the first.
    """

    def __init__(self, stale_ns: Mapping[Kind, int], now_ns: NowNs) -> None:
        """Follow the kinds that are keys of `stale_ns`, whose values are the ages above which they are not valid."""
        self.newest_ns: int | None = None
        self._stale_ns = stale_ns
        self._now_ns = now_ns
        self._received_ns: dict[Kind, int] = {}

    def mark(self, kind: Kind, received_ns: int) -> None:
        """Note that a frame of this kind arrived intact."""
        self._received_ns[kind] = received_ns
        self.newest_ns = received_ns if self.newest_ns is None else max(self.newest_ns, received_ns)

    def age(self, kind: Kind, stale_ns: int | None = None, now_ns: int | None = None) -> tuple[float, bool]:
        """Age of the newest frame of a kind, s, infinite where none has arrived, and whether it is fresh enough.

        Args:
            kind: Which.
            stale_ns: The age above which it is not, ns, for what the frame carries beside its quicker values; where
                left out, the one that was given for the kind.
            now_ns: The time, for who asks for several kinds at once.
        """
        received_ns = self._received_ns.get(kind)
        if received_ns is None or self.newest_ns is None:
            return math.inf, False
        if now_ns is None:
            now_ns = self._now_ns()
        age_ns = now_ns - received_ns
        limit_ns = self._stale_ns[kind] if stale_ns is None else stale_ns
        if now_ns - self.newest_ns <= limit_ns:
            limit_ns = limit_ns * PATIENCE_PERIODS // STALE_PERIODS
        return age_ns * 1e-9, age_ns <= limit_ns
