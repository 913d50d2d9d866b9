"""Heartbeats to the robots, and the round trip by their echo. Pure: time is given."""

from collections import deque
from typing import Final

from node.supervisor.heard import ModeHeard

PERIOD_NS: Final = 100_000_000
_KEPT: Final = 50
"""Stamps that an echo may bear: those of five seconds."""
_HEARS_NS: Final = 1_000_000_000
"""A robot that heard us longer ago does not hear us."""


class Heartbeats:
    """One clock of heartbeats for all robots; only stamps that we sent count as echoes of ours.

    Attributes:
        name: Our name.
    """

    def __init__(self, name: str) -> None:
        """Beat as `name`."""
        self.name = name
        self._sent: deque[int] = deque(maxlen=_KEPT)

    def due(self, now_ns: int) -> int | None:
        """The stamp of a heartbeat to send now, or None."""
        if self._sent and now_ns - self._sent[-1] < PERIOD_NS:
            return None
        self._sent.append(now_ns)
        return now_ns

    def round_trip_s(self, mode: ModeHeard, heard_ns: int) -> float | None:
        """From our heartbeat to the robot's echo, without the time the robot kept it; None where it does not hear us.

        Args:
            mode: What the robot said.
            heard_ns: When that reached us, monotonic.
        """
        if mode.station != self.name or mode.beat_ns not in self._sent or mode.beat_age_ns > _HEARS_NS:
            return None
        return max(heard_ns - mode.beat_ns - mode.beat_age_ns, 0) * 1e-9
