# SPDX-License-Identifier: MIT
"""The base station as the robot sees it: its heartbeats, and what the robot does by itself when they end.

Only heartbeats of a station that was introduced count: by the robot file, or by itself when an operator of it takes
control. Whoever else publishes some neither makes the robot rely on them nor hides that its own station is lost.
"""

from collections.abc import MutableSequence, Sequence
from typing import Final, NamedTuple

from segway_ecc.node.cycle.arming import ArmingManager
from segway_ecc.node.cycle.interfaces import Heartbeat, Inbox
from segway_ecc.node.safety.modes import STATION_LOST, StationWatch, Watch, sit_down_values
from segway_ecc.node.safety.settings import StationSettings

SITS_DOWN: Final = f"{STATION_LOST}: the robot sits down"
_ECHOED: Final = 4
"""How many stations get their heartbeats back."""
_MOST_INTRODUCED: Final = 4
_KEPT_NS: Final = 1_000_000_000
"""A station that introduced itself keeps its place against others while its heartbeats are no further apart."""
_MOST_LOGGED: Final = 20
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
        self._declared = () if settings is None else settings.names
        self._introduced: dict[str, int] = {}
        self._kept_for = _KEPT_NS // period_ns
        self._logged = 0
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

    def is_introduced(self, station: str) -> bool:
        """Whether the heartbeats of this station count."""
        return station in self._declared or station in self._introduced

    def look(self, cycle: int, set_values: MutableSequence[float], events: MutableSequence[str], inbox: Inbox) -> bool:
        """Whether the station that watched over the robot is lost; what follows from it is done.

        Args:
            cycle: The number of the cycle.
            set_values: The robot's set values; written in each cycle of sitting down, so that nobody else makes it
                stand up before a station is back.
            events: Where it is logged.
            inbox: What arrived in this cycle.
        """
        for station in inbox.introductions:
            self._introduce(station, cycle, events)
        has_heartbeat = self._has_heartbeat(inbox.stations, cycle) if inbox.stations else False
        watch = self._watch.look(cycle, has_heartbeat=has_heartbeat, is_live=self._arming.is_live)
        before, self._seen = self._seen, watch
        if watch is Watch.ALONE and before is not Watch.ALONE:
            self._introduced.clear()  # it is disarmed, and they are gone: who arms it next introduces itself
        if self._seen >= Watch.SIT_DOWN and self._sit_down:
            for place, value in self._sit_down:
                set_values[place] = value
            if before < Watch.SIT_DOWN:
                events.append(SITS_DOWN)
        if self._seen is Watch.DISARM:
            self._arming.disarm(STATION_LOST)
        return self._seen >= Watch.LOST

    def _has_heartbeat(self, heartbeats: Sequence[Heartbeat], cycle: int) -> bool:
        """Whether one of these heartbeats counts."""
        found = [heartbeat.station for heartbeat in heartbeats if self.is_introduced(heartbeat.station)]
        for station in found:
            if station in self._introduced:
                self._introduced[station] = cycle
        return bool(found)

    def _introduce(self, station: str, cycle: int, events: MutableSequence[str]) -> None:
        if self.is_introduced(station):
            return
        refusal, introduced = "", self._introduced
        if self._declared:
            refusal = f"the robot file declares {', '.join(self._declared)}"
        elif len(introduced) == _MOST_INTRODUCED:
            oldest = min(introduced, key=introduced.__getitem__)
            if cycle - introduced[oldest] <= self._kept_for:
                refusal = f"{', '.join(introduced)} are there already"
            else:
                del introduced[oldest]
        if not refusal:
            introduced[station] = cycle
        if self._logged < _MOST_LOGGED:
            self._logged += 1
            events.append(
                f"base station '{station}' is not introduced: {refusal}"
                if refusal
                else f"base station '{station}' is introduced: its heartbeats count"
            )
