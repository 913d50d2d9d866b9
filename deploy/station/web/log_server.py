# SPDX-License-Identifier: MIT
"""Serves the page that plays one log, and nothing else, to the browsers of this machine; nobody has to sign in."""

import asyncio
import os
import socket
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Final

from aiohttp import web

from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.station.web.app import PLAYER, page_file, page_files, prepare
from segway_ecc.deploy.station.web.downloads import player_path
from segway_ecc.deploy.station.web.log_views import LogViews
from segway_ecc.deploy.station.web.server import Stoppable, ending
from segway_ecc.deploy.station.web.shared import Cause, RefusedRequestError, json_response, refusal
from segway_ecc.deploy.station.web.site_address import SiteAddress

_ENDS_WITHIN_S: Final = 1.0


class LogServer:
    """Answers requests about one log."""

    def __init__(self, path: Path, place: SiteAddress) -> None:
        """Serve a log at `place`."""
        self._path = path
        self._place = place
        self._files = page_files()
        self._views = LogViews(self._open)

    def app(self) -> web.Application:
        """The application."""
        app = web.Application(middlewares=[self._guard])
        app.on_response_prepare.append(prepare)
        app.on_cleanup.append(self._close)
        get = app.router.add_get
        get("/", self._root)
        get(PLAYER, self._page)
        get("/static/{path:.+}", self._page)
        get("/session", self._session, allow_head=False)
        get("/logs", self._root)
        get("/logs/{name}/view", self._views.whole, allow_head=False)
        get("/logs/{name}/rows", self._views.rows, allow_head=False)
        return app

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Refuse pages of other sites, also those whose name server points at us (DNS rebinding)."""
        try:
            self._check(request)
            return await handler(request)
        except RefusedRequestError as error:
            return refusal(error.cause)
        except web.HTTPException as error:
            return refusal(Cause.NOT_FOUND if isinstance(error, web.HTTPNotFound) else Cause.BAD_REQUEST)

    def _check(self, request: web.Request) -> None:
        if not self._place.is_ours(request.headers.get("Host")):
            raise RefusedRequestError(Cause.FOREIGN_HOST)
        if not self._place.may_request(request.method, request.headers, opens_socket=False):
            raise RefusedRequestError(Cause.FOREIGN_ORIGIN)

    async def _root(self, _: web.Request) -> web.Response:
        return web.Response(status=303, headers={"Location": player_path(self._path.name)})

    async def _session(self, _: web.Request) -> web.Response:
        return json_response({"login": False, "who": "", "role": Role.VIEWER})

    async def _page(self, request: web.Request) -> web.Response:
        return page_file(self._files, request.match_info.get("path", "log.html"))

    def _open(self, request: web.Request) -> int:
        if request.match_info["name"] != self._path.name:
            raise FileNotFoundError
        return os.open(self._path, os.O_RDONLY | os.O_CLOEXEC)

    async def _close(self, _: web.Application) -> None:
        self._views.close()


def serve_log(
    path: Path, sockets: Sequence[socket.socket], place: SiteAddress, stoppable: Stoppable, ready: Callable[[], None]
) -> str:
    """Serve a log until a signal, which is returned; the sockets are bound, browsers can connect at `ready`."""

    async def serve_until_stopped() -> str:
        runner = web.AppRunner(LogServer(path, place).app(), access_log=None, shutdown_timeout=_ENDS_WITHIN_S)
        with ending(stoppable) as ended:
            await runner.setup()
            try:
                for bound in sockets:
                    await web.SockSite(runner, bound).start()
                ready()
                return await ended
            finally:
                await runner.cleanup()

    return asyncio.run(serve_until_stopped())
