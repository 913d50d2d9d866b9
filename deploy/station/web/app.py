# SPDX-License-Identifier: MIT
"""The routes, and the page's files."""

import asyncio
import importlib.resources
import logging
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Final, TypeAlias

from aiohttp import WebSocketError, WSCloseCode, WSMsgType, web

from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.station.web.authentication import AuthenticationMiddleware, address_of
from segway_ecc.deploy.station.web.browser import Browser, Peer
from segway_ecc.deploy.station.web.connection_limiter import ConnectionLimiter
from segway_ecc.deploy.station.web.downloads import Downloads
from segway_ecc.deploy.station.web.log_views import LogViews
from segway_ecc.deploy.station.web.shared import Cause, RefusedRequestError, SharedServices, json_response, refusal
from segway_ecc.deploy.station.web.websocket_hub import WebSocketHub

MOST_BODY_BYTES: Final = 4096
LARGEST_FRAME: Final = 512 * 1024
"""Of a message; what is larger is not even read, and the socket is closed (RFC 6455, 7.4.1: code 1009)."""
_HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'self'; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'; "
        "object-src 'none'"
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
_ONLY_TLS: Final = "max-age=31536000"
"""A browser that was here once speaks TLS only for a year (RFC 6797): nobody in between can have it speak without."""
PLAYER: Final = "/log"
"""The page that plays a log."""
_WITH_FORMS: Final = ("/logs", "/robots/")
_Handler: TypeAlias = Callable[[web.Request], Awaitable[web.StreamResponse]]
_logger = logging.getLogger(__name__)
_TYPES: Final = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    "": "text/plain",
}


class WebApplication:
    """Answers requests; `connections` is reported what becomes of the connection of each, once there is one."""

    def __init__(
        self,
        shared: SharedServices,
        hub: WebSocketHub,
        authentication: AuthenticationMiddleware,
        downloads: Downloads,
    ) -> None:
        """Answer nothing yet; `close` ends what requests begin."""
        self.connections: ConnectionLimiter | None = None
        self._shared = shared
        self._hub = hub
        self._authentication = authentication
        self._files = page_files()
        self._downloads = downloads
        self._log_views = LogViews(downloads.open_log)

    def close(self) -> None:
        """End the process that reads logs."""
        self._log_views.close()

    def app(self) -> web.Application:
        """The application."""
        app = web.Application(middlewares=[self._guard], client_max_size=MOST_BODY_BYTES)
        app.on_response_prepare.append(prepare)
        downloads, views, audited = self._downloads, self._log_views, self._audited
        get, post = app.router.add_get, app.router.add_post
        get("/", self._page)
        get(PLAYER, self._player)
        get("/static/{path:.+}", self._page)
        get("/health", self._health)
        get("/session", self._session, allow_head=False)
        post("/login", self._authentication.login)
        post("/logout", self._authentication.logout)
        get("/socket", self._socket, allow_head=False)
        get("/refused", self._refused)
        get("/robots/{robot}/trace", self._trace, allow_head=False)
        get("/logs", self._listed(downloads.logs))
        get("/logs/{name}", audited(downloads.log, "log"), allow_head=False)
        get("/logs/{name}/view", audited(views.whole, "view"), allow_head=False)
        get("/logs/{name}/rows", self._rows, allow_head=False)
        get("/robots/{robot}/bundle", audited(downloads.bundle, "bundle", Role.OPERATOR), allow_head=False)
        get("/robots/{robot}/logs", self._listed(downloads.robot_logs))
        get("/robots/{robot}/logs/{name}", audited(downloads.robot_log, "log"), allow_head=False)
        get("/robots/{robot}/logs/{name}/view", audited(views.whole, "view"), allow_head=False)
        get("/robots/{robot}/logs/{name}/rows", self._rows, allow_head=False)
        post("/robots/{robot}/logs/{name}", audited(downloads.fetch, "fetch", Role.OPERATOR))
        return app

    @web.middleware
    async def _guard(self, request: web.Request, handler: _Handler) -> web.StreamResponse:
        """Check each request, and answer each failure: one request that fails must not end the station."""
        try:
            if self.connections is not None:
                self.connections.on_request(request.transport)
            self._authentication.check(request)
            return await handler(request)
        except RefusedRequestError as error:
            cause = error.cause
        except web.HTTPRequestEntityTooLarge:
            cause = Cause.OVERSIZED
        except web.HTTPNotFound:
            cause = Cause.NOT_FOUND
        except web.HTTPException:
            cause = Cause.BAD_REQUEST
        except ConnectionError:
            raise
        except Exception as error:  # noqa: BLE001 - one request that fails must not end the station
            cause = Cause.FAILED
            _log_once(self._shared.refusals, error)
        self._shared.refusals[cause] += 1
        return refusal(cause)

    async def _page(self, request: web.Request) -> web.Response:
        return page_file(self._files, request.match_info.get("path", "index.html"))

    async def _player(self, _: web.Request) -> web.Response:
        return page_file(self._files, "log.html")

    async def _health(self, _: web.Request) -> web.Response:
        if self._hub.is_stalled:
            return web.Response(text="the robots' side of the station is stalled\n", status=503)
        return web.Response(text="ok\n")

    async def _session(self, request: web.Request) -> web.Response:
        carrier = web.Response()
        session = self._authentication.session_or_new(request, carrier)
        if session is None:
            return json_response({"login": True, "who": "", "role": ""})
        response = json_response({"login": False, "who": session.who, "role": session.role})
        response.cookies.update(carrier.cookies)
        return response

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        heartbeat_s = self._shared.limits.ping_s
        socket = web.WebSocketResponse(heartbeat=heartbeat_s, max_msg_size=LARGEST_FRAME, compress=False)
        if not socket.can_prepare(request).ok:
            raise RefusedRequestError(Cause.BAD_REQUEST)
        session = self._authentication.session_or_new(request, socket)
        if session is None:
            raise RefusedRequestError(Cause.NO_SESSION)
        address = address_of(request)
        if self._hub.is_full(address, session.role):
            raise RefusedRequestError(Cause.TOO_MANY_SOCKETS)
        await socket.prepare(request)
        if self.connections is not None:
            self.connections.on_browser(request.transport)
        transport = request.transport if isinstance(request.transport, asyncio.WriteTransport) else None
        peer = Peer(address, transport, inflates=request.query.get("pictures") == "deflate")
        browser = Browser(self._shared, socket, session, peer)
        await self._serve(browser, socket)
        return socket

    async def _serve(self, browser: Browser, socket: web.WebSocketResponse) -> None:
        refusals = self._shared.refusals
        self._hub.add(browser)
        sender = asyncio.create_task(browser.send())
        try:
            async for message in socket:
                if message.type in {WSMsgType.TEXT, WSMsgType.BINARY}:
                    browser.receive(message.data)
                else:  # aiohttp closes the socket: what came was too large, or no message of the protocol
                    error = message.data
                    is_oversized = isinstance(error, WebSocketError) and error.code == WSCloseCode.MESSAGE_TOO_BIG
                    refusals[Cause.OVERSIZED if is_oversized else Cause.MALFORMED] += 1
        except Exception as error:  # noqa: BLE001 - one browser that fails must not end the station
            _log_once(refusals, error)
            refusals[Cause.FAILED] += 1
        finally:
            self._hub.remove(browser)
            sender.cancel()

    async def _refused(self, request: web.Request) -> web.Response:
        self._authentication.session(request, Role.OPERATOR)
        shared = self._shared
        return json_response({"web": dict(shared.refusals.most_common()), "station": shared.robots.refused()})

    async def _trace(self, request: web.Request) -> web.Response:
        self._authentication.session(request)
        response = json_response(self._hub.traces.of(request.match_info["robot"]))
        response.enable_compression()
        return response

    async def _rows(self, request: web.Request) -> web.Response:
        self._authentication.session(request)
        if self.connections is not None:
            self.connections.on_download(request.transport)
        return await self._log_views.rows(request)

    def _listed(self, handler: Callable[..., Awaitable[web.Response]]) -> _Handler:
        """A handler for sessions, which shows operators what they may fetch."""

        async def listed(request: web.Request) -> web.StreamResponse:
            role = self._authentication.session(request).role
            return await handler(request, may_fetch=role is Role.OPERATOR)

        return listed

    def _audited(self, handler: _Handler, act: str, role: Role = Role.VIEWER) -> _Handler:
        """A handler for sessions of a role, whose requests are noted in the audit log."""

        async def audited(request: web.Request) -> web.StreamResponse:
            self._authentication.note(request, act, self._authentication.session(request, role))
            if self.connections is not None:
                self.connections.on_download(request.transport)
            return await handler(request)

        return audited


def _log_once(refusals: Counter[Cause], error: Exception) -> None:
    if refusals[Cause.FAILED] == 0:
        _logger.error("a request failed, and the station goes on", exc_info=error)


def page_file(files: Mapping[str, tuple[bytes, str]], path: str) -> web.Response:
    """A file of the page.

    Raises:
        RefusedRequestError: There is none.
    """
    if path not in files:
        raise RefusedRequestError(Cause.NOT_FOUND)
    content, kind = files[path]
    return web.Response(body=content, content_type=kind, charset="utf-8")


async def prepare(request: web.Request, response: web.StreamResponse) -> None:
    """Set the headers of every response."""
    response.headers.update(_HEADERS)
    if request.secure:
        response.headers["Strict-Transport-Security"] = _ONLY_TLS
    if request.path.startswith(_WITH_FORMS):
        # Without a referrer browsers send a form with the origin `null`, which could be anybody's (Fetch, "origin").
        response.headers["Referrer-Policy"] = "same-origin"
    # The page's own files are requested each time, so that a new station is never seen through an old page.
    is_ours = request.path in {"/", PLAYER} or request.path.startswith("/static/")
    response.headers["Cache-Control"] = "no-cache" if is_ours else "no-store"
    response.headers.popall("Server", None)


def page_files(folder: Traversable | None = None, prefix: str = "") -> dict[str, tuple[bytes, str]]:
    """Every file of the page by its path, with its MIME type; nothing else can be requested, whatever path is given."""
    found: dict[str, tuple[bytes, str]] = {}
    for item in (folder or importlib.resources.files("segway_ecc.deploy.station") / "page").iterdir():
        path = f"{prefix}{item.name}"
        kind = _TYPES.get(Path(item.name).suffix)
        if item.is_dir():
            found |= page_files(item, f"{path}/")
        elif kind is not None and not item.name.startswith("."):
            found[path] = (item.read_bytes(), kind)
    return found
