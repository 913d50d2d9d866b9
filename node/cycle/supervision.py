"""The base station as the robot sees it: its heartbeats, and what the robot does by itself when they end."""

from collections.abc import MutableSequence, Sequence
from typing import Final

from node.cycle.authority import Authority
from node.cycle.seams import Heartbeat
from node.safety.modes import STATION_LOST
from node.safety.settings import StationSettings
from node.safety.station import StationWatch, Watch, sit_down_values

SITS_DOWN: Final = f"{STATION_LOST}: the robot sits down"


class Supervision:
    """Hears heartbeats; sits the robot down and disarms it when they have ended for long.

    Attributes:
        heartbeat: The newest, of any station; None where none was ever heard.
        heard_ns: When that came, monotonic.
    """

    def __init__(
        self, settings: StationSettings | None, set_names: Sequence[str], authority: Authority, period_ns: int
    ) -> None:
        """Watch as the robot file says; None only hears.

        Raises:
            UnknownNameError: What is to be set is not among `set_names`.
        """
        self.heartbeat: Heartbeat | None = None
        self.heard_ns = 0
        self._authority = authority
        self._sit_down = sit_down_values(settings, set_names)
        self._watch = StationWatch(settings, period_ns)
        self._seen = Watch.ALONE

    def hear(self, heartbeats: Sequence[Heartbeat], now_ns: int) -> None:
        """Take the heartbeats of a cycle."""
        if heartbeats:
            self.heartbeat, self.heard_ns = heartbeats[-1], now_ns

    def look(
        self, cycle: int, set_values: MutableSequence[float], events: MutableSequence[str], *, is_heard: bool
    ) -> bool:
        """Whether the station that watched over the robot is lost; what follows from it is done.

        Args:
            cycle: The number of the cycle.
            set_values: The robot's set values; written in each cycle of sitting down, so that nobody else makes it
                stand up before a station is heard again.
            events: Where it is told.
            is_heard: Whether a heartbeat came in this cycle.
        """
        before, self._seen = self._seen, self._watch.look(cycle, is_heard=is_heard, is_live=self._authority.is_live)
        if self._seen >= Watch.SIT_DOWN and self._sit_down:
            for place, value in self._sit_down:
                set_values[place] = value
            if before < Watch.SIT_DOWN:
                events.append(SITS_DOWN)
        if self._seen is Watch.DISARM:
            self._authority.disarm(STATION_LOST)
        return self._seen >= Watch.LOST
