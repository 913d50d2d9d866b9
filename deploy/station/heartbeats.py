# SPDX-License-Identifier: MIT
"""Heartbeats to the robots, and the round trip by their echo. Pure: time is given."""

from collections import deque
from typing import Final

from segway_ecc.deploy.station.robot_messages import ModeReport

PERIOD_NS: Final = 100_000_000
_KEPT: Final = 50
"""Stamps that an echo may carry: those of five seconds."""
_ECHO_WITHIN_NS: Final = 1_000_000_000
"""Without an echo for longer the robot does not receive our heartbeats."""


class Heartbeats:
    """One clock of heartbeats for all robots; only stamps that we sent count as echoes of ours.

    Attributes:
        name: Our name.
    """

    def __init__(self, name: str) -> None:
        """Send as `name`."""
        self.name = name
        self._sent: deque[int] = deque(maxlen=_KEPT)
        self._round_trips: dict[str, tuple[float, int]] = {}

    def due(self, now_ns: int) -> int | None:
        """The stamp of a heartbeat to send now, or None."""
        if self._sent and now_ns - self._sent[-1] < PERIOD_NS:
            return None
        self._sent.append(now_ns)
        return now_ns

    def on_mode(self, robot: str, mode: ModeReport, at_ns: int) -> None:
        """Measure the round trip from a mode report received at `at_ns`, monotonic, where it echoes us."""
        if mode.station == self.name and mode.beat_ns in self._sent and mode.beat_age_ns <= _ECHO_WITHIN_NS:
            self._round_trips[robot] = (max(at_ns - mode.beat_ns - mode.beat_age_ns, 0) * 1e-9, at_ns)

    def round_trip_s(self, robot: str, now_ns: int) -> float | None:
        """From our heartbeat to the echo, without the time the robot kept it; None without a recent echo."""
        round_trip_s, at_ns = self._round_trips.get(robot, (None, 0))
        return round_trip_s if now_ns - at_ns <= _ECHO_WITHIN_NS else None
