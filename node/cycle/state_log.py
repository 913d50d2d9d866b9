"""What people are told while the loop runs: changes of mode, and what keeps the robot from arming."""

import logging
from collections import deque
from typing import Final

from segway_ecc.node.cycle.clock import NS_PER_S, Clock
from segway_ecc.node.safety.modes import Mode, Modes

_INTERVAL_NS: Final = NS_PER_S
_logger = logging.getLogger(__name__)


class StateLog:
    """Tells what is new, at most once a second, so that no flicker can flood the log; the newest is told."""

    def __init__(self, clock: Clock) -> None:
        """Tell on a clock."""
        self._clock = clock
        self._logged: tuple[Mode, bool, str] | None = None
        self._logged_ns: int | None = None

    def log_state(self, modes: Modes, obstacle: str | None) -> None:
        """Tell the mode and what keeps the robot from arming, where they have changed."""
        new = modes.mode, obstacle is None, modes.reason if obstacle is None else obstacle
        if new == self._logged:
            return
        now_ns = self._clock.now_ns()
        if self._logged_ns is not None and now_ns - self._logged_ns < _INTERVAL_NS:
            return
        self._logged, self._logged_ns = new, now_ns
        mode, can_arm, why = new
        _logger.info("%s: %s" if can_arm else "%s, cannot arm: %s", mode, why)

    def log_event(self, events: deque[str]) -> None:
        """Tell the oldest of what happened, if anything has."""
        if events:
            _logger.warning(events.popleft())
