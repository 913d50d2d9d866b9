# SPDX-License-Identifier: MIT
"""All browsers: each picture is encoded once for all of them."""

import asyncio
import logging
from collections import Counter
from collections.abc import Callable
from typing import Final

import msgspec
from aiohttp import WSCloseCode

from segway_ecc.deploy.station.views import FleetView, HelloView
from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.station.web.browser import Browser
from segway_ecc.deploy.station.web.limits import site_of
from segway_ecc.deploy.station.web.pictures import Picture
from segway_ecc.deploy.station.web.shared import Cause, SharedServices
from segway_ecc.deploy.station.web.traces import Traces

DRIVE_PERIOD_S: Final = 0.1
FRESH_S: Final = 1.0
"""A picture that is older when a browser shows it is too old to act on."""
_POLL_S: Final = 0.01
"""How often it is checked whether there is a new picture, so that none waits for long; one comes every 50 ms."""
_SWEEP_NS: Final = 1_000_000_000
_STALLED_NS: Final = 5_000_000_000
_OLD_EVENTS: Final = 200
_logger = logging.getLogger(__name__)


class WebSocketHub:
    """Sends pictures and events to all browsers."""

    def __init__(self, shared: SharedServices, version: str) -> None:
        self._robots, _, self._refusals, self._limits, self._clock_ns = shared
        self._version = version
        self._browsers: set[Browser] = set()
        self._by_site: Counter[str] = Counter()
        self._view: FleetView | None = None
        self._picture: Picture | None = None
        self._changed_ns = shared.clock_ns()
        self._event = 0
        self.traces = Traces()
        self.is_empty = asyncio.Event()
        """Set while no browser is connected."""
        self.is_empty.set()

    def __len__(self) -> int:
        return len(self._browsers)

    @property
    def is_stalled(self) -> bool:
        """Whether the station has given no new picture for seconds."""
        return self._clock_ns() - self._changed_ns > _STALLED_NS

    def is_full(self, address: str, role: Role) -> bool:
        """Whether there are too many browsers to add another of this address; viewers leave some for operators."""
        limits = self._limits
        kept = limits.sockets_kept if role is Role.VIEWER else 0
        is_site_full = self._by_site[site_of(address)] >= limits.sockets_each - kept
        return len(self) >= limits.sockets - kept or is_site_full

    def add(self, browser: Browser) -> None:
        """Add a browser: send it who it is, what happened lately and the newest picture."""
        self._browsers.add(browser)
        self.is_empty.clear()
        self._by_site[site_of(browser.address)] += 1
        browser.session.sockets += 1
        limits = self._robots.limits
        hello = HelloView(
            who=browser.session.who,
            role=browser.session.role,
            version=self._version,
            drive_period_s=DRIVE_PERIOD_S,
            max_linear=limits.linear_velocity,
            max_angular=limits.angular_velocity,
            fresh_s=FRESH_S,
            trials=self._robots.trials,
        )
        browser.queue(msgspec.json.encode(hello))
        for event in self._robots.events(max(self._event - _OLD_EVENTS, 0)):
            if event.number <= self._event:
                browser.queue(msgspec.json.encode(event))
        if self._picture is not None:
            browser.show(self._picture)

    def remove(self, browser: Browser) -> None:
        """Remove a browser that is gone; with the last of an operator's, so are they."""
        self._browsers.discard(browser)
        self._by_site -= Counter((site_of(browser.address),))  # a count of zero is not kept
        browser.on_closed()
        browser.session.sockets -= 1
        if browser.session.sockets == 0:
            self._robots.leave(browser.session.who)
        if not self._browsers:
            self.is_empty.set()

    def end(self, reason: str) -> None:
        """Close every socket with a reason."""
        for browser in self._browsers:
            browser.end(WSCloseCode.GOING_AWAY, reason)

    async def run(self, sweep: Callable[[], None]) -> None:
        """Send what is new, until cancelled; `sweep` is called about once a second."""
        next_ns = self._clock_ns()
        while True:
            try:
                self._broadcast()
                if self._clock_ns() >= next_ns:
                    next_ns = self._clock_ns() + _SWEEP_NS
                    self._sweep()
                    sweep()
            except Exception:
                # One picture that fails must not freeze all that follow.
                self._refusals[Cause.FAILED] += 1
                if self._refusals[Cause.FAILED] == 1:
                    _logger.exception("the station could not send what is new, and goes on")
            await asyncio.sleep(_POLL_S)

    def _broadcast(self) -> None:
        for event in self._robots.events(self._event):
            self._event = max(self._event, event.number)
            encoded = msgspec.json.encode(event)
            for browser in self._browsers:
                browser.queue(encoded)
        view = self._robots.fleet()
        if view is self._view:
            return
        self._view = view
        self._changed_ns = self._clock_ns()
        self.traces.add(view)
        self._picture = Picture(view)
        for browser in self._browsers:
            browser.show(self._picture)

    def _sweep(self) -> None:
        now_ns = self._clock_ns()
        for browser in list(self._browsers):
            if browser.session.is_over:
                browser.end(WSCloseCode.POLICY_VIOLATION, "the session is over; log in again")
            if browser.is_stuck(now_ns):
                browser.abort(Cause.TOO_SLOW)
