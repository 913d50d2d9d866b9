# SPDX-License-Identifier: MIT
"""The web server of the base station, from its sockets to its end."""

import asyncio
import contextlib
import logging
import socket
import ssl
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Final, NamedTuple, Self, TypeAlias

from aiohttp import web

from segway_ecc.deploy.station.archive_client import ArchiveClient
from segway_ecc.deploy.station.web.access import Access
from segway_ecc.deploy.station.web.app import WebApplication
from segway_ecc.deploy.station.web.audit import AuditEntry, AuditLog
from segway_ecc.deploy.station.web.authentication import AuthenticationMiddleware
from segway_ecc.deploy.station.web.connection_limiter import ConnectionLimiter
from segway_ecc.deploy.station.web.downloads import Bundle, Downloads
from segway_ecc.deploy.station.web.limits import Limits
from segway_ecc.deploy.station.web.shared import Cause, Robots, SharedServices
from segway_ecc.deploy.station.web.site_address import SiteAddress
from segway_ecc.deploy.station.web.websocket_hub import WebSocketHub

_KEPT_ALIVE_S: Final = 15.0
_ENDS_WITHIN_S: Final = 2.0
_http_logger = logging.getLogger(f"{__name__}.http")

Stoppable: TypeAlias = Callable[[Callable[[str], None]], AbstractContextManager[None]]
"""Given what ends us, a context in which signals do."""


class ServerSettings(NamedTuple):
    """How a station is served.

    Attributes:
        folder: Where the audit log goes.
        logs: Where recorded logs lie.
        access: Who has a token; None where none is needed.
        tls: The certificate, or None for plain HTTP.
        clock_ns: Monotonic, ns.
        wall_ns: ns since the Unix epoch.
    """

    place: SiteAddress
    folder: Path
    logs: Path
    version: str
    bundle: Bundle
    archive: ArchiveClient
    access: Access | None = None
    tls: ssl.SSLContext | None = None
    limits: Limits = Limits()
    clock_ns: Callable[[], int] = time.monotonic_ns
    wall_ns: Callable[[], int] = time.time_ns


class Server:
    """Serves while its context lasts."""

    def __init__(self, robots: Robots, sockets: Sequence[socket.socket], settings: ServerSettings) -> None:
        """Serve on sockets that are bound; they are ours from now on."""
        self._sockets = sockets
        self._settings = settings
        audit = AuditLog(settings.folder, settings.wall_ns)
        self.shared = SharedServices(robots, audit, Counter(), settings.limits, settings.clock_ns)
        self.hub = WebSocketHub(self.shared, settings.version)
        self._authentication = AuthenticationMiddleware(settings.place, settings.access, self.shared)
        downloads = Downloads(settings.logs, settings.bundle, settings.archive, robots.fleet, settings.clock_ns)
        self._application = WebApplication(self.shared, self.hub, self._authentication, downloads)

    async def __aenter__(self) -> Self:
        _http_logger.addFilter(self._count_bad_http)
        _http_logger.setLevel(logging.DEBUG)  # at which aiohttp logs some of it
        self._runner = web.AppRunner(
            self._application.app(),
            access_log=None,
            logger=_http_logger,
            keepalive_timeout=_KEPT_ALIVE_S,
            lingering_time=0.0,
            shutdown_timeout=_ENDS_WITHIN_S,
        )
        await self._runner.setup()
        server, settings = self._runner.server, self._settings
        if server is None:
            raise RuntimeError("aiohttp gave no server")
        self._limiter = ConnectionLimiter(server, self.shared, settings.tls)
        self._application.connections = self._limiter
        for listening in self._sockets:
            self._limiter.open(listening)

        def sweep() -> None:
            self._authentication.sessions.sweep(settings.clock_ns())
            self._limiter.sweep()

        self._broadcasting = asyncio.create_task(self.hub.run(sweep))
        self.shared.audit.add(AuditEntry(act="starts", outcome="done", text=settings.version))
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the listening sockets, then those of the browsers, and end; within a few seconds in any case."""
        self._limiter.close()
        self.hub.end("the station ends")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_ENDS_WITHIN_S):
                await self.hub.is_empty.wait()
        self._broadcasting.cancel()
        # Before the threads that wait for robots are waited for.
        await asyncio.to_thread(self._settings.archive.close)
        await asyncio.to_thread(self._application.close)
        await self._runner.cleanup()
        _http_logger.removeFilter(self._count_bad_http)
        self.shared.audit.add(AuditEntry(act="ends", outcome="done"))
        await asyncio.to_thread(self.shared.audit.close)

    def _count_bad_http(self, record: logging.LogRecord) -> bool:
        """Bad HTTP is counted and not logged: strangers decide how much of it there is."""
        if str(record.msg).startswith("Error handling request"):
            self.shared.refusals[Cause.BAD_HTTP] += 1
        return False


@contextlib.contextmanager
def ending(stoppable: Stoppable) -> Iterator[asyncio.Future[str]]:
    """What ends us, once something does, by its first cause; within a running event loop."""
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[str] = loop.create_future()

    def note(cause: str) -> None:
        if not ended.done():
            ended.set_result(cause)

    def end(cause: str) -> None:
        with contextlib.suppress(RuntimeError):  # a second signal, after the end
            loop.call_soon_threadsafe(note, cause)

    with stoppable(end):
        yield ended


def serve(
    robots: Robots,
    sockets: Sequence[socket.socket],
    settings: ServerSettings,
    stoppable: Stoppable,
    ready: Callable[[], None],
) -> Mapping[str, object]:
    """Serve until a signal; return what was counted.

    The sockets are bound, and ours from now on. Signals end us through `stoppable`; browsers can connect at `ready`.
    """

    async def serve_until_stopped() -> Mapping[str, object]:
        with ending(stoppable) as ended:
            async with Server(robots, sockets, settings) as server:
                ready()
                cause = await ended
        return {
            "ended_by": cause,
            "refused": dict(server.shared.refusals.most_common()),
            "station_refused": dict(robots.refused()),
            "audit_lost": server.shared.audit.lost,
        }

    return asyncio.run(serve_until_stopped())
