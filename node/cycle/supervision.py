# SPDX-License-Identifier: MIT
"""The base station as the robot sees it: its heartbeats, and what the robot does by itself when they end."""

from collections.abc import MutableSequence, Sequence
from typing import Final, NamedTuple

from segway_ecc.node.cycle.arming import ArmingManager
from segway_ecc.node.cycle.interfaces import Heartbeat
from segway_ecc.node.safety.modes import STATION_LOST, StationWatch, Watch, sit_down_values
from segway_ecc.node.safety.settings import StationSettings

SITS_DOWN: Final = f"{STATION_LOST}: the robot sits down"
_ECHOED: Final = 4
"""How many stations get their heartbeats back."""
_ECHOED_FOR_NS: Final = 1_000_000_000
_TURN_NS: Final = 100_000_000
"""For how long one of several stations is echoed before the next."""


class Echo(NamedTuple):
    """A heartbeat as it is echoed, and when it was received, monotonic, ns."""

    heartbeat: Heartbeat
    received_ns: int


class Supervision:
    """Receives heartbeats; sits the robot down and disarms it when they have been missing for long."""

    def __init__(
        self, settings: StationSettings | None, set_names: Sequence[str], arming: ArmingManager, period_ns: int
    ) -> None:
        """Watch by the robot file's settings; None only echoes.

        Raises:
            UnknownNameError: What is to be set is not among `set_names`.
        """
        self._echoes: dict[str, Echo] = {}
        self._arming = arming
        self._sit_down = sit_down_values(settings, set_names)
        self._watch = StationWatch(settings, period_ns)
        self._seen = Watch.ALONE

    def receive_heartbeats(self, heartbeats: Sequence[Heartbeat], now_ns: int) -> None:
        """Take the heartbeats of a cycle."""
        for heartbeat in heartbeats:
            self._echoes.pop(heartbeat.station, None)
            if len(self._echoes) == _ECHOED:
                del self._echoes[next(iter(self._echoes))]  # the one that was received the longest ago
            self._echoes[heartbeat.station] = Echo(heartbeat, now_ns)

    def echo(self, now_ns: int) -> Echo | None:
        """The newest heartbeat of a station, of each in turn that sent one lately; None before the first."""
        if not self._echoes:
            return None
        echoes = list(self._echoes.values())
        lately = [echo for echo in echoes if now_ns - echo.received_ns <= _ECHOED_FOR_NS] or echoes[-1:]
        turn = now_ns // _TURN_NS
        return sorted(lately)[turn % len(lately)]

    def look(
        self, cycle: int, set_values: MutableSequence[float], events: MutableSequence[str], *, has_heartbeat: bool
    ) -> bool:
        """Whether the station that watched over the robot is lost; what follows from it is done.

        Args:
            cycle: The number of the cycle.
            set_values: The robot's set values; written in each cycle of sitting down, so that nobody else makes it
                stand up before a station is back.
            events: Where it is logged.
            has_heartbeat: Whether a heartbeat came in this cycle.
        """
        before, self._seen = (
            self._seen,
            self._watch.look(cycle, has_heartbeat=has_heartbeat, is_live=self._arming.is_live),
        )
        if self._seen >= Watch.SIT_DOWN and self._sit_down:
            for place, value in self._sit_down:
                set_values[place] = value
            if before < Watch.SIT_DOWN:
                events.append(SITS_DOWN)
        if self._seen is Watch.DISARM:
            self._arming.disarm(STATION_LOST)
        return self._seen >= Watch.LOST
