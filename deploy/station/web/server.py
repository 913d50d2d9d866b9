"""The web server of the base station, from its sockets to its end."""

import asyncio
import contextlib
import logging
import socket
import ssl
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple, Self

from aiohttp import web

from segway_ecc.deploy.station.web.access import Access
from segway_ecc.deploy.station.web.app import Site
from segway_ecc.deploy.station.web.audit import AuditEntry, AuditLog
from segway_ecc.deploy.station.web.authentication import AuthenticationMiddleware
from segway_ecc.deploy.station.web.browser import SharedServices
from segway_ecc.deploy.station.web.connection_limiter import ConnectionLimiter
from segway_ecc.deploy.station.web.downloads import Downloads, DownloadSources
from segway_ecc.deploy.station.web.interfaces import Archive, Bundle, Robots
from segway_ecc.deploy.station.web.limits import Limits
from segway_ecc.deploy.station.web.origins import SiteAddress
from segway_ecc.deploy.station.web.refusals import Cause, Refusals
from segway_ecc.deploy.station.web.websocket_hub import WebSocketHub

_KEPT_ALIVE_S: Final = 15.0
_TOLD_WITHIN_S: Final = 2.0
_http_logger = logging.getLogger(f"{__name__}.http")


class ServerSettings(NamedTuple):
    """How a station is served.

    Attributes:
        place: Where it is.
        folder: Where the audit log goes.
        logs: Where recorded logs lie.
        version: Of segway-ecc.
        access: Who has a token; None where none is needed.
        tls: The certificate, or None for plain HTTP.
        limits: What it bears.
        bundle: Makes support bundles.
        archive: Fetches logs from robots.
        clock_ns: Monotonic, ns.
        wall_ns: ns since the Unix epoch.
    """

    place: SiteAddress
    folder: Path
    logs: Path
    version: str
    access: Access | None = None
    tls: ssl.SSLContext | None = None
    limits: Limits = Limits()
    bundle: Bundle | None = None
    archive: Archive | None = None
    clock_ns: Callable[[], int] = time.monotonic_ns
    wall_ns: Callable[[], int] = time.time_ns


class Server:
    """Serves while its context lasts."""

    def __init__(self, robots: Robots, sockets: Sequence[socket.socket], settings: ServerSettings) -> None:
        """Serve on sockets that are bound; they are ours from now on."""
        self.refusals = Refusals()
        self._robots = robots
        self._sockets = sockets
        self._settings = settings
        self.audit = AuditLog(settings.folder, settings.wall_ns)
        desk = SharedServices(robots, self.audit, self.refusals, settings.limits, settings.clock_ns)
        self.crowd = WebSocketHub(robots, settings.limits, self.refusals, settings.clock_ns, settings.version)
        self._gate = AuthenticationMiddleware(
            settings.place, settings.access, settings.limits, self.audit, settings.clock_ns
        )
        downloads = Downloads(
            DownloadSources(settings.logs, settings.bundle, settings.archive), robots.fleet, settings.clock_ns
        )
        self._site = Site(desk, self.crowd, self._gate, downloads)

    async def __aenter__(self) -> Self:
        _http_logger.addFilter(self._count_bad_http)
        _http_logger.setLevel(logging.DEBUG)  # at which aiohttp says some of it
        self._runner = web.AppRunner(
            self._site.app(),
            access_log=None,
            logger=_http_logger,
            keepalive_timeout=_KEPT_ALIVE_S,
            lingering_time=0.0,
            shutdown_timeout=_TOLD_WITHIN_S,
        )
        await self._runner.setup()
        server = self._runner.server
        if server is None:
            raise RuntimeError("aiohttp gave no server")
        self._door = ConnectionLimiter(
            server, self._settings.limits, self.refusals, self._settings.clock_ns, self._settings.tls
        )
        self._site.heard = self._door.heard
        for listening in self._sockets:
            self._door.open(listening)
        self._showing = asyncio.create_task(self.crowd.run(self._sweep))
        self.audit.add(AuditEntry(act="starts", outcome="done", text=self._settings.version))
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let nobody in, tell who is there, and end; within a few seconds, whoever does not listen."""
        self._door.shut()
        self.crowd.end("the station ends")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_TOLD_WITHIN_S):
                await self.crowd.is_empty.wait()
        self._showing.cancel()
        if self._settings.archive is not None:
            # Before the threads that wait for robots are waited for.
            await asyncio.to_thread(self._settings.archive.close)
        await self._runner.cleanup()
        _http_logger.removeFilter(self._count_bad_http)
        self.audit.add(AuditEntry(act="ends", outcome="done"))
        await asyncio.to_thread(self.audit.close)

    def report(self) -> Mapping[str, object]:
        """What there was to count."""
        return {
            "refused": dict(self.refusals.counts()),
            "station_refused": dict(self._robots.refused()),
            "audit_lost": self.audit.lost,
        }

    def _sweep(self) -> None:
        self._gate.sessions.sweep(self._settings.clock_ns())
        self._door.sweep()

    def _count_bad_http(self, record: logging.LogRecord) -> bool:
        """What is no HTTP is counted and not written: strangers decide how much of it there is."""
        if str(record.msg).startswith("Error handling request"):
            self.refusals.add(Cause.BAD_HTTP)
        return False
