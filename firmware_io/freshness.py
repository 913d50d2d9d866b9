"""How old the newest frame of each kind is, and whether that is fresh enough."""

import math
from collections.abc import Callable, Hashable, Mapping
from typing import Final, Generic, TypeVar

NowNs = Callable[[], int]
Kind = TypeVar("Kind", bound=Hashable)

STALE_PERIODS: Final = 3
"""A value older than this many of its own periods, or of the loop's if those are longer, is not valid."""


def stale_after_ns(frame_period_s: float, loop_period_s: float) -> int:
    """Age above which a value from a frame that comes at this period is not valid, ns."""
    return round(STALE_PERIODS * max(frame_period_s, loop_period_s) * 1e9)


class Freshness(Generic[Kind]):
    """Remembers when each kind of frame last arrived intact.

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

    def age(self, kind: Kind) -> tuple[float, bool]:
        """Age of the newest frame of a kind, s, infinite where none has arrived, and whether it is fresh enough."""
        received_ns = self._received_ns.get(kind)
        if received_ns is None:
            return math.inf, False
        age_ns = self._now_ns() - received_ns
        return age_ns * 1e-9, age_ns <= self._stale_ns[kind]
