# SPDX-License-Identifier: MIT
"""The station's event log: a ring that any thread may read."""

import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

from segway_ecc.deploy.station.views import EventView

CAPACITY: Final = 1000
_LONGEST_TEXT: Final = 500


class EventLog:
    """Keeps the newest events; discarding the oldest leaves the numbers of the others as they are."""

    def __init__(self, wall_ns: Callable[[], int], capacity: int = CAPACITY) -> None:
        """Keep `capacity` events, stamped by `wall_ns` (ns since the Unix epoch)."""
        self._wall_ns = wall_ns
        self._events: deque[EventView] = deque(maxlen=capacity)
        self._count = 0
        self._lock = threading.Lock()

    def add(self, robot: str, text: str, *, level: str = "info", who: str = "") -> None:
        """Keep an event; a text that is too long is shortened, as some of it comes from the network."""
        with self._lock:
            self._count += 1
            event = EventView(
                number=self._count, wall_ns=self._wall_ns(), robot=robot, text=clipped(text), level=level, who=who
            )
            self._events.append(event)

    def after(self, number: int) -> Sequence[EventView]:
        """The events that are kept and whose number is greater, oldest first."""
        with self._lock:
            new = min(self._count - number, len(self._events))
            return [self._events[index] for index in range(len(self._events) - new, len(self._events))]


def clipped(text: str) -> str:
    """A text of the network, short enough to be kept and shown."""
    return text if len(text) <= _LONGEST_TEXT else text[: _LONGEST_TEXT - 3] + "..."
