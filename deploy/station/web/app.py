"""The routes."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Final

from aiohttp import WebSocketError, WSCloseCode, WSMsgType, web

from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.station.web.audit import AuditEntry
from segway_ecc.deploy.station.web.authentication import AuthenticationMiddleware, address_of
from segway_ecc.deploy.station.web.browser import Browser, SharedServices, Visit
from segway_ecc.deploy.station.web.downloads import Downloads
from segway_ecc.deploy.station.web.files import charset, page_files
from segway_ecc.deploy.station.web.refusals import Cause
from segway_ecc.deploy.station.web.responses import RefusedRequestError, json_answer, refusal
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
_WITH_FORMS: Final = ("/logs", "/robots/")
_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
_logger = logging.getLogger(__name__)


class Site:
    """Answers requests."""

    def __init__(
        self, desk: SharedServices, crowd: WebSocketHub, gate: AuthenticationMiddleware, downloads: Downloads
    ) -> None:
        """Answer with these parts."""
        self.heard: Callable[[asyncio.BaseTransport | None], None] = lambda _: None
        self._desk = desk
        self._crowd = crowd
        self._gate = gate
        self._files = page_files()
        self._downloads = downloads
        self._clock_ns = desk.clock_ns

    def app(self) -> web.Application:
        """The application."""
        app = web.Application(middlewares=[self._guard], client_max_size=MOST_BODY_BYTES)
        app.on_response_prepare.append(_prepare)
        get, post = app.router.add_get, app.router.add_post
        get("/", self._page)
        get("/static/{path:.+}", self._page)
        get("/health", self._health)
        get("/session", self._session, allow_head=False)
        post("/login", self._gate.login)
        post("/logout", self._gate.logout)
        get("/socket", self._socket, allow_head=False)
        get("/refused", self._refused)
        get("/logs", self._logs)
        get("/logs/{name}", self._log, allow_head=False)
        get("/robots/{robot}/bundle", self._bundle, allow_head=False)
        get("/robots/{robot}/logs", self._robot_logs)
        get("/robots/{robot}/logs/{name}", self._robot_log, allow_head=False)
        post("/robots/{robot}/logs/{name}", self._fetch)
        return app

    @web.middleware
    async def _guard(self, request: web.Request, handler: _Handler) -> web.StreamResponse:
        """What every request passes; whatever becomes of it, the station goes on."""
        try:
            self.heard(request.transport)
            self._gate.check(request)
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
            self._tell_once(error)
        self._desk.refusals.add(cause)
        return refusal(cause)

    async def _page(self, request: web.Request) -> web.Response:
        file = self._files.get(request.match_info.get("path", "index.html"))
        if file is None:
            raise RefusedRequestError(Cause.NOT_FOUND)
        return web.Response(body=file.content, content_type=file.kind, charset=charset(file.kind))

    async def _health(self, _: web.Request) -> web.Response:
        if self._crowd.is_frozen:
            return web.Response(text="the robots' side of the station stands still\n", status=503)
        return web.Response(text="ok\n")

    async def _session(self, request: web.Request) -> web.Response:
        carrier = web.Response()
        session = self._gate.session_or_new(request, carrier)
        if session is None:
            return json_answer({"login": True, "who": "", "role": ""})
        answer = json_answer({"login": False, "who": session.who, "role": session.role})
        answer.cookies.update(carrier.cookies)
        return answer

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        heartbeat_s = self._desk.limits.ping_s
        socket = web.WebSocketResponse(heartbeat=heartbeat_s, max_msg_size=LARGEST_FRAME, compress=False)
        if not socket.can_prepare(request).ok:
            raise RefusedRequestError(Cause.BAD_REQUEST)
        session = self._gate.session_or_new(request, socket)
        if session is None:
            raise RefusedRequestError(Cause.NO_SESSION)
        address = address_of(request)
        cause = self._crowd.refusal(address)
        if cause is not None:
            raise RefusedRequestError(cause)
        self._gate.use_key(request)
        await socket.prepare(request)
        transport = request.transport if isinstance(request.transport, asyncio.WriteTransport) else None
        browser = Browser(self._desk, Visit(session, address, transport), socket, self._clock_ns())
        await self._serve(browser, socket)
        return socket

    async def _serve(self, browser: Browser, socket: web.WebSocketResponse) -> None:
        self._crowd.enter(browser)
        sender = asyncio.create_task(browser.send())
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    browser.take(message.data, self._clock_ns())
                elif message.type is WSMsgType.BINARY:
                    browser.take_bytes(self._clock_ns())
                else:
                    self._desk.refusals.add(_cause_of(message.data))
        except Exception as error:  # noqa: BLE001 - one browser that fails must not end the station
            self._tell_once(error)
            self._desk.refusals.add(Cause.FAILED)
        finally:
            self._crowd.leave(browser)
            sender.cancel()

    def _tell_once(self, error: Exception) -> None:
        if self._desk.refusals.of(Cause.FAILED) == 0:
            _logger.error("a request failed, and the station goes on", exc_info=error)

    async def _refused(self, request: web.Request) -> web.Response:
        self._gate.session(request, Role.OPERATOR)
        return json_answer({"web": self._desk.refusals.counts(), "station": self._desk.robots.refused()})

    async def _logs(self, request: web.Request) -> web.Response:
        role = self._gate.session(request).role
        return await self._downloads.logs(request, may_fetch=role is Role.OPERATOR)

    async def _robot_logs(self, request: web.Request) -> web.Response:
        role = self._gate.session(request).role
        return await self._downloads.robot_logs(request, may_fetch=role is Role.OPERATOR)

    async def _robot_log(self, request: web.Request) -> web.StreamResponse:
        self._note(request, "log", robot=request.match_info["robot"], text=request.match_info["name"])
        return await self._downloads.robot_log(request)

    async def _fetch(self, request: web.Request) -> web.Response:
        self._note(request, "fetch", Role.OPERATOR, robot=request.match_info["robot"], text=request.match_info["name"])
        return await self._downloads.fetch(request)

    async def _log(self, request: web.Request) -> web.StreamResponse:
        self._note(request, "log", text=request.match_info["name"])
        return await self._downloads.log(request)

    async def _bundle(self, request: web.Request) -> web.StreamResponse:
        self._note(request, "bundle", Role.OPERATOR, robot=request.match_info["robot"])
        return await self._downloads.bundle(request)

    def _note(
        self, request: web.Request, act: str, role: Role = Role.VIEWER, *, robot: str = "", text: str = ""
    ) -> None:
        session = self._gate.session(request, role)
        entry = AuditEntry(
            who=session.who,
            role=session.role,
            address=address_of(request),
            act=act,
            robot=robot[:256],
            outcome="done",
            text=text,
        )
        self._desk.audit.add(entry)


def _cause_of(error: object) -> Cause:
    """Why aiohttp closes a socket: what came was too large, or no message of the protocol."""
    is_oversized = isinstance(error, WebSocketError) and error.code == WSCloseCode.MESSAGE_TOO_BIG
    return Cause.OVERSIZED if is_oversized else Cause.MALFORMED


async def _prepare(request: web.Request, response: web.StreamResponse) -> None:
    """What stands in every answer."""
    response.headers.update(_HEADERS)
    if request.path.startswith(_WITH_FORMS):
        # Without a referrer browsers send a form with the origin `null`, which could be anybody's (Fetch, "origin").
        response.headers["Referrer-Policy"] = "same-origin"
    # The page's own files are asked for each time, so that a new station is never seen through an old page.
    is_ours = request.path == "/" or request.path.startswith("/static/")
    response.headers["Cache-Control"] = "no-cache" if is_ours else "no-store"
    response.headers.popall("Server", None)
