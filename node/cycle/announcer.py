"""What people are told while the loop runs: changes of mode, and what keeps the robot from arming."""

import logging
from collections import deque
from typing import Final

from node.cycle.clock import NS_PER_S, Clock
from node.safety.modes import Modes

_INTERVAL_NS: Final = NS_PER_S
_logger = logging.getLogger(__name__)


class Announcer:
    """Tells what is new, at most once a second, so that no flicker can flood the log; the newest is told."""

    def __init__(self, clock: Clock) -> None:
        """Tell on a clock."""
        self._clock = clock
        self._told = ""
        self._told_ns: int | None = None

    def tell(self, modes: Modes, obstacle: str | None) -> None:
        """Tell the mode and what keeps the robot from arming, where they have changed."""
        text = f"{modes.mode}: {modes.reason}" if obstacle is None else f"{modes.mode}, cannot arm: {obstacle}"
        if text == self._told:
            return
        now_ns = self._clock.now_ns()
        if self._told_ns is not None and now_ns - self._told_ns < _INTERVAL_NS:
            return
        self._told, self._told_ns = text, now_ns
        _logger.info(text)

    def tell_event(self, events: deque[str]) -> None:
        """Tell the oldest of what happened, if anything has."""
        if events:
            _logger.warning(events.popleft())
