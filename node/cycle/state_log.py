# SPDX-License-Identifier: MIT
"""What people read while the loop runs: changes of mode, refusals to arm, and events."""

import logging
from collections import deque
from typing import Final

from segway_ecc.node.cycle.clock import NS_PER_S, Clock
from segway_ecc.node.safety.modes import Mode, Modes

_INTERVAL_NS: Final = NS_PER_S
_logger = logging.getLogger(__name__)


class StateLog:
    """Logs the newest state where it has changed, at most once a second: no flicker floods the log."""

    def __init__(self, clock: Clock) -> None:
        """Take time from a clock."""
        self._clock = clock
        self._logged: tuple[Mode, bool, str] | None = None
        self._logged_ns: int | None = None

    def log_state(self, modes: Modes, arming_refusal: str | None) -> None:
        """Log the mode with its reason, or why the robot that arms itself cannot arm."""
        new = modes.mode, arming_refusal is None, modes.reason if arming_refusal is None else arming_refusal
        if new == self._logged:
            return
        now_ns = self._clock.now_ns()
        if self._logged_ns is not None and now_ns - self._logged_ns < _INTERVAL_NS:
            return
        self._logged, self._logged_ns = new, now_ns
        mode, can_arm, why = new
        _logger.info("%s: %s" if can_arm else "%s, cannot arm: %s", mode, why)

    def log_event(self, events: deque[str]) -> None:
        """Log the oldest event, if there is any."""
        if events:
            _logger.warning(events.popleft())

    def log_events(self, events: deque[str]) -> None:
        """Log all events, the oldest first."""
        while events:
            self.log_event(events)
