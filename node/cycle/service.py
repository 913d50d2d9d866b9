# SPDX-License-Identifier: MIT
"""The node as the service manager sees it: readiness, status, and the watchdog's keep-alive while deadlines are met.

The protocol is that of sd_notify(3): datagrams to the socket that NOTIFY_SOCKET names. Nothing here waits or raises,
and nothing is sent where the node was not started as a service.
"""

import contextlib
import json
import os
import socket
from collections.abc import Mapping, Sequence
from typing import Final

from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.cycle.timing import LoopCounters
from segway_ecc.node.safety.deadlines import LATE_FRACTION
from segway_ecc.node.safety.modes import ACTIVE

NOTIFY_SOCKET: Final = "NOTIFY_SOCKET"
WATCHDOG_USEC: Final = "WATCHDOG_USEC"
WATCHDOG_PID: Final = "WATCHDOG_PID"
MISSED_BUDGET: Final = 0.1
"""The fraction of the deadlines in a stretch that may be missed."""
READY_AFTER_NS: Final = 1_000_000_000
_FEEDS_IN_TIMEOUT: Final = 4
_NS_PER_US: Final = 1000
_CHECK: Final = "check."
_REFUSED: Final = "refused: "
# systemd takes datagrams of at most 4096 bytes; a letter of UTF-8 has up to four.
_MOST_LETTERS: Final = 160
_MOST_BLOCKED: Final = 5


class NotifySocket:
    """The way to the service manager; silent where none `is_named`. Counts the datagrams that were `dropped`."""

    def __init__(self, address: str) -> None:
        """Send to `address`, a path or, beginning with @, a name in the kernel's abstract namespace (unix(7))."""
        self.dropped = 0
        self.is_named = address[:1] in {"/", "@"} and len(address) > 1
        self._address = f"\0{address[1:]}" if address.startswith("@") else address

    def send(self, text: str) -> bool:
        """Send one datagram; False where it did not get through."""
        if not self.is_named:
            return False
        try:
            # A socket of its own, as sd_notify(3) does: there are some five a second, and nothing is left to close.
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as sock:
                sock.sendto(text.encode(), self._address)
        except OSError:
            self.dropped += 1
            return False
        return True


class _Stretch:
    """Deadlines in a row, most of which have to be met."""

    def __init__(self, length_ns: int, period_ns: int) -> None:
        self._length = max(length_ns // period_ns, 1)
        self._passed = self._missed = 0

    def add(self, passed: int, missed: int) -> bool:
        """Add deadlines that have passed; True where that completes a stretch in which few were missed."""
        self._passed += passed
        self._missed += missed
        if self._passed < self._length:
            return False
        is_good = self._missed <= MISSED_BUDGET * self._passed
        self._passed = self._missed = 0
        return is_good


class Service:
    """The loop as the service manager sees it.

    It is ready after a second in which it met its deadlines, and feeds the watchdog after each quarter of the
    watchdog's time-out in which it did. A cycle that starts later than half a period, or not at all, has missed its
    deadline; one in ten may. Time is counted in deadlines, so that only a loop that runs reports that it does.

    Attributes:
        is_one: Whether this process was started as a service.
    """

    def __init__(self, notify: NotifySocket, period_ns: int, watchdog_ns: int | None = None) -> None:
        """Report to `notify` on a loop of this period, ns; no watchdog is fed where its time-out is None."""
        self.is_one = notify.is_named
        self._notify = notify
        self._period_ns = period_ns
        self._late_ns = round(LATE_FRACTION * period_ns)
        self._is_ready = False
        self._skipped = 0
        self._reported = (0, 0)
        self._ready = _Stretch(READY_AFTER_NS, period_ns)
        self._watchdog = None if watchdog_ns is None else _Stretch(watchdog_ns // _FEEDS_IN_TIMEOUT, period_ns)

    def look(self, lateness_ns: int, skipped: int) -> None:
        """Take a cycle that started so long after its deadline, ns; `skipped` deadlines have been since the start."""
        if not self.is_one:
            return
        new = skipped - self._skipped
        self._skipped = skipped
        missed = new + (lateness_ns > self._late_ns)
        if self._watchdog is not None and self._watchdog.add(1 + new, missed):
            self._notify.send("WATCHDOG=1")
        if not self._is_ready and self._ready.add(1 + new, missed):
            self._is_ready = self._notify.send("READY=1")  # what did not get through is sent a second later

    def report(self, statuses: Sequence[DiagnosticStatus], loop: LoopCounters) -> None:
        """Send the status: the first of the diagnostics, which is the mode with the checks, and the loop's counters."""
        if not self.is_one or not statuses:
            return
        cycles, deadlines = loop.cycles, loop.cycles + loop.skipped
        passed = deadlines - self._reported[1]
        rate_hz = (cycles - self._reported[0]) / (passed * self._period_ns * 1e-9) if passed else 0.0
        self._reported = cycles, deadlines
        self._notify.send(f"STATUS={status_text(statuses[0].values, rate_hz, loop.late, loop.skipped)}")

    def stopping(self) -> None:
        """Report that the node is on its way out."""
        self._notify.send("STOPPING=1")


def status_text(mode: Mapping[str, str], rate_hz: float, late: int, skipped: int) -> str:
    """The status as one line of JSON.

    Args:
        mode: The values of the mode's diagnostic status: `mode`, `reason`, and `check.NAME` for each pre-arm check.
        rate_hz: Cycles per second since the last report.
        late: Cycles that started late since the start.
        skipped: Deadlines skipped since the start.
    """
    blocked = []
    if mode.get("mode") not in ACTIVE:
        refused = (name for name, text in mode.items() if name.startswith(_CHECK) and text.startswith(_REFUSED))
        blocked = [f"{name.removeprefix(_CHECK)}: {mode[name].removeprefix(_REFUSED)}" for name in refused]
    status = {
        "mode": mode.get("mode", ""),
        "reason": _short(mode.get("reason", "")),
        "rate_hz": round(rate_hz, 2),
        "late": late,
        "skipped": skipped,
        "blocked_by": [_short(text) for text in blocked[:_MOST_BLOCKED]],
    }
    return json.dumps(status, ensure_ascii=False)


def _short(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text[:_MOST_LETTERS])


def service_of(environment: Mapping[str, str], period_ns: int) -> Service:
    """The service that this process is, by NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID (sd_watchdog_enabled(3))."""
    timeout_us = 0
    if environment.get(WATCHDOG_PID, str(os.getpid())) == str(os.getpid()):  # else it is another process' watchdog
        with contextlib.suppress(ValueError):
            timeout_us = int(environment.get(WATCHDOG_USEC, "0"))
    watchdog_ns = timeout_us * _NS_PER_US if timeout_us > 0 else None
    return Service(NotifySocket(environment.get(NOTIFY_SOCKET, "")), period_ns, watchdog_ns)
