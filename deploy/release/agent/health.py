# SPDX-License-Identifier: MIT
"""Whether a node that was just restarted is healthy."""

import time
from typing import Final

from segway_ecc.deploy.release.agent.services import NODE, Service, show

_POSTURE: Final = frozenset({"imu_still", "tilt", "wheels_still"})
"""Pre-arm checks of how the robot stands, not of how well its software runs."""
RATE_TOLERANCE: Final = 0.01


class Trial:
    """Watches a node that was just restarted; pure: it is given what systemd shows, and when.

    Args:
        for_s: How long it must be healthy on end, s.
        start_s: How long it may take besides until it is.
        rate_hz: The rate that its loop should have; None where that is not known.
        before: The node before it was restarted: what kept the robot from arming then is not held against it.
    """

    def __init__(self, for_s: float, start_s: float, rate_hz: float | None, before: Service) -> None:
        self._for_s, self._start_s = for_s, start_s
        self._rate_hz, self._before = rate_hz, before
        self._since_s: float | None = None
        self._pid = 0
        self.reason = "nothing was seen of it yet"

    def watch(self, node: Service, elapsed_s: float) -> bool | None:
        """True once it is healthy, False once it is not, for `reason`, None while that is open."""
        if (fatal := self._fatal(node)) is not None:
            self.reason = fatal
            return False
        self.reason = self._lacks(node) or ""
        if self.reason:
            self._since_s = None
            return False if elapsed_s > self._start_s + self._for_s else None
        self._pid = node.pid
        if self._since_s is None:
            self._since_s = elapsed_s
        return True if elapsed_s - self._since_s >= self._for_s else None

    def _fatal(self, node: Service) -> str | None:
        if node.load != "loaded":
            return f"{NODE} is not installed ({node.load})"
        if node.active in {"failed", "inactive"}:
            return f"{NODE} is {node.active}"
        if node.restarts not in {0, self._before.restarts}:
            return f"{NODE} had to be restarted {node.restarts} times"
        if self._pid and node.pid != self._pid:
            return f"{NODE} ended and was started again"
        if node.mode == "FAULT":
            return f"the robot is in FAULT: {(node.status or {}).get('reason', '')}"
        return None

    def _lacks(self, node: Service) -> str | None:
        if node.active != "active":
            return f"{NODE} is still {node.active} ({node.sub})"
        if node.status is None:
            return f"{NODE} reports no status"
        rate = node.status.get("rate_hz")
        if not isinstance(rate, int | float):
            return "the node does not report its rate"
        if self._rate_hz is not None and not abs(rate - self._rate_hz) <= RATE_TOLERANCE * self._rate_hz:
            return f"its loop runs at {rate:g} Hz instead of {self._rate_hz:g} Hz"
        blocked = node.blocked_by() - _POSTURE - self._before.blocked_by()
        if blocked:
            texts = [str(t) for t in node.status["blocked_by"] if str(t).partition(":")[0] in blocked]
            return f"the robot cannot be armed: {'; '.join(texts)}"
        return None


def watched(trial: Trial, every_s: float) -> bool:
    """Watch until it is clear whether the node is healthy."""
    began_s = time.monotonic()
    while True:
        verdict = trial.watch(show(), time.monotonic() - began_s)
        if verdict is not None:
            return verdict
        time.sleep(every_s)
