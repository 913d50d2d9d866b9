# SPDX-License-Identifier: MIT
"""A base station that a test controls: it serves the page and speaks the socket, in a thread of its own."""

import asyncio
import contextlib
import dataclasses
import threading
import time
import zlib
from collections import deque
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
from aiohttp import WSMsgType, web

from segway_ecc.deploy.station.views import (
    Act,
    Command,
    Drive,
    EventView,
    FleetView,
    HelloView,
    ReplyView,
    RobotView,
    Seen,
    SeenView,
)
from tests.patience import PATIENCE_S

PAGE: Final = Path(__file__).parents[4] / "deploy" / "station" / "page"
CSP: Final = "default-src 'self'"
_FRAME_S: Final = 0.05
_MOST_UNSEEN: Final = 2
_TYPES: Final = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}

HELLO: Final = HelloView(
    who="ann", role="operator", version="0.1.0", drive_period_s=0.05, max_linear=1.0, max_angular=2.0, fresh_s=60.0
)
"""Its pictures may be so old that no stall of the machine makes them stale; a test of that says `limit_age`."""

T = TypeVar("T")
Answer = tuple[bool, str] | None
"""Accepted or not and the robot's words; None for no answer."""


@dataclasses.dataclass
class Script:
    """How the station behaves; a test changes it while it runs.

    Attributes:
        robots: What is reported, by namespace.
        sends: Whether pictures are sent at all.
        ticks: Whether their time goes on.
        accepts: Whether a socket is taken.
        token: What /login wants; empty for none.
        hello: Said first on each socket.
        events: Told to each new socket.
        trace: What is kept of a robot's last minutes.
        answers: What commands come to; accepted where not named.
        react: Called with each command, in the station's thread.
    """

    robots: dict[str, RobotView] = dataclasses.field(default_factory=dict)
    sends: bool = True
    ticks: bool = True
    accepts: bool = True
    token: str = ""
    hello: HelloView = HELLO
    events: list[EventView] = dataclasses.field(default_factory=list)
    trace: dict[str, list[float | None]] = dataclasses.field(default_factory=lambda: {"time_s": []})
    answers: dict[Act, Answer] = dataclasses.field(default_factory=dict)
    react: Callable[[Command], object] = lambda _: None


class FakeStation:
    """Runs the server until it is closed; what it received stands in `commands` and `drives`.

    Its time is simulated: it goes on by one period with each picture, and the next is not made before the page has all
    but one of those before. So a page or a machine that stalls finds no older picture afterwards, and none left out.
    """

    def __init__(self) -> None:
        """Start on a free port of loopback."""
        self.script = Script()
        self.commands: list[Command] = []
        self.drives: list[Drive] = []
        self.refused: list[str] = []
        self.ids: list[int] = []
        self.sent: list[float] = []
        self.seen: list[float] = []
        self.logins: list[dict[str, str]] = []
        self.fetched: list[str] = []
        self.traced: list[str] = []
        self.sockets = 0
        self.frames = 0
        self._time_s = 1000.0
        self._late_s = 0.0
        self._ticked_s = time.monotonic()
        self._taken = 0
        self._was_taken = asyncio.Event()
        self._open: dict[web.WebSocketResponse, deque[tuple[int, float]]] = {}
        self._inflating: set[web.WebSocketResponse] = set()
        self._sessions: set[str] = set()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self.port = self._call(self._start())

    @property
    def url(self) -> str:
        """Of the page."""
        return f"http://127.0.0.1:{self.port}/"

    def robot(self, namespace: str = "/alice", /, **fields: object) -> RobotView:
        """Change what is reported of a robot, or add one."""
        old = self.script.robots.get(namespace, RobotView(robot=namespace))
        new = msgspec.structs.replace(old, **fields)
        self.script.robots = dict(sorted({**self.script.robots, namespace: new}.items()))
        return new

    def tell(self, event: EventView) -> None:
        """Send an event to everybody."""
        self.script.events.append(event)
        self._call(self._send(event))

    def delay(self, late_s: float) -> None:
        """Have each picture that follows be on the way for so long, s; the next is no older than the last for that."""
        self._call(self._delay(late_s))

    def limit_age(self, fresh_s: float) -> None:
        """Say anew how old a picture may be, s."""
        self.script.hello = msgspec.structs.replace(self.script.hello, fresh_s=fresh_s)
        self._call(self._send(self.script.hello))

    def fall_silent(self) -> None:
        """Send no more pictures, so that the newest is soon too old."""
        self._call(self._fall_silent())
        self.limit_age(1.0)

    def stand_still(self) -> None:
        """Send pictures whose time stands still, so that it is soon too old."""
        self.script.ticks = False
        self.wait_seen(1)
        self.limit_age(1.0)

    def go_on(self) -> None:
        """Send pictures again, which may be old."""
        self.limit_age(HELLO.fresh_s)
        self.script.ticks = self.script.sends = True

    def cut(self) -> None:
        """Close every socket."""
        self._call(self._cut())

    def reconnect(self) -> None:
        """Close every socket, and wait until the page has another."""
        before = self._call(self._cut())
        self.wait(lambda: self.sockets > before)

    def close(self) -> None:
        """End the server and its thread."""
        self._call(self._stop())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE_S)
        self._loop.close()

    def wait(self, condition: Callable[[], T]) -> T:
        """Wait until a condition holds, and return what it gave.

        Raises:
            AssertionError: It did not within the deadline.
        """
        deadline = time.monotonic() + PATIENCE_S
        while not (value := condition()):
            assert time.monotonic() < deadline, "waited in vain"
            time.sleep(0.005)
        return value

    def wait_frames(self, count: int) -> None:
        """Wait until some more pictures were made, so that the page has had time to do what it should not do."""
        goal = self.frames + count
        self.wait(lambda: self.frames >= goal)

    def wait_seen(self, count: int) -> None:
        """Wait until the page took some more pictures that are made from now on."""
        goal = len(self.sent) + count
        self.wait(lambda: self._taken >= goal)

    def wait_drives(self, count: int) -> None:
        """Wait until some more set-points came, so that the last was asked after all that the test did."""
        goal = len(self.drives) + count
        self.wait(lambda: len(self.drives) >= goal)

    def _call(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(PATIENCE_S)

    async def _start(self) -> int:
        app = web.Application()
        app.router.add_get("/", self._index)
        app.router.add_get("/static/{path:.+}", self._static)
        app.router.add_get("/session", self._session)
        app.router.add_post("/login", self._login)
        app.router.add_post("/logout", self._logout)
        app.router.add_get("/logs", self._fetch)
        app.router.add_get("/robots/{robot}/bundle", self._fetch)
        app.router.add_get("/robots/{robot}/trace", self._trace)
        app.router.add_get("/socket", self._socket)
        self._runner = web.AppRunner(app)
        await self._runner.setup()
        site = web.TCPSite(self._runner, "127.0.0.1", 0)
        await site.start()
        self._ticker = asyncio.ensure_future(self._tick())
        return int(self._runner.addresses[0][1])

    async def _stop(self) -> None:
        self._ticker.cancel()
        await self._cut()
        # A page that is gone leaves answers behind that nobody reads: closing would wait for them.
        for connection in [] if self._runner.server is None else self._runner.server.connections:
            if connection.transport is not None:
                connection.transport.abort()
        await self._runner.cleanup()

    async def _cut(self) -> int:
        """Close every socket; how many there were until then."""
        count = self.sockets
        for socket in list(self._open):
            await socket.close()
        return count

    async def _delay(self, late_s: float) -> None:
        self._time_s += late_s - self._late_s
        self._late_s = late_s

    def _now_s(self) -> float:
        """The station's clock, s; it stands where nothing ticks."""
        since_s = time.monotonic() - self._ticked_s
        return self._time_s + (min(since_s, _FRAME_S) if self.script.ticks else 0.0)

    @property
    def _is_ahead(self) -> bool:
        """Whether a page has yet to take so many pictures that none is made."""
        most = _MOST_UNSEEN if self.script.sends else 1
        return any(len(unseen) >= most for unseen in self._open.values())

    async def _fall_silent(self) -> None:
        self.script.sends = False
        while any(self._open.values()):
            await self._next_taken()

    async def _next_taken(self) -> None:
        self._was_taken.clear()
        await self._was_taken.wait()

    async def _tick(self) -> None:
        while True:
            while self._is_ahead:
                await self._next_taken()
            await asyncio.sleep(_FRAME_S)
            self._time_s += _FRAME_S if self.script.ticks else 0.0
            self._ticked_s = time.monotonic()
            if self.script.sends:
                made_s = self._time_s - self._late_s
                self.sent.append(made_s)
                for unseen in self._open.values():
                    unseen.append((len(self.sent), made_s))
                await self._send(FleetView(time_s=made_s, robots=list(self.script.robots.values())))
            self.frames += 1

    async def _send(self, view: msgspec.Struct) -> None:
        data = msgspec.json.encode(view)
        for socket in list(self._open):
            # A page that is left or reloads is gone in the midst of it.
            with contextlib.suppress(ConnectionError):
                if isinstance(view, FleetView) and socket in self._inflating:
                    await socket.send_bytes(zlib.compress(data))
                else:
                    await socket.send_str(data.decode())

    async def _index(self, _: web.Request) -> web.Response:
        return _file(PAGE / "index.html", "text/html")

    async def _static(self, request: web.Request) -> web.Response:
        path = PAGE / request.match_info["path"]
        return _file(path, _TYPES[path.suffix])

    async def _session(self, request: web.Request) -> web.Response:
        known = not self.script.token or request.cookies.get("session") in self._sessions
        hello = self.script.hello
        return web.json_response({"login": not known, "who": hello.who if known else "", "role": hello.role})

    async def _login(self, request: web.Request) -> web.Response:
        asked = await request.json()
        self.logins.append(asked)
        if self.script.token and asked["token"] != self.script.token:
            return web.json_response({"error": "the token is wrong"}, status=403)
        self._sessions.add("known")
        self.script.hello = msgspec.structs.replace(self.script.hello, who=asked["name"])
        response = web.Response(status=204)
        response.set_cookie("session", "known", httponly=True, samesite="Strict")
        return response

    async def _logout(self, _: web.Request) -> web.Response:
        self._sessions.clear()
        return web.Response(status=204)

    async def _fetch(self, request: web.Request) -> web.Response:
        self.fetched.append(request.match_info.get("robot", "logs"))
        return web.Response(body=b"bundle", headers={"Content-Disposition": "attachment; filename=bundle.zip"})

    async def _trace(self, request: web.Request) -> web.Response:
        self.traced.append(request.match_info["robot"])
        return web.json_response(self.script.trace)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        known = not self.script.token or request.cookies.get("session") in self._sessions
        if not (self.script.accepts and known):
            return web.Response(status=403)
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        for view in (self.script.hello, *self.script.events):
            await socket.send_str(msgspec.json.encode(view).decode())
        self._open[socket] = deque()
        self.sockets += 1
        if request.query.get("pictures") == "deflate":
            self._inflating.add(socket)
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    with contextlib.suppress(ConnectionError):
                        await self._take(socket, message.data)
        finally:
            self._open.pop(socket, None)
            self._was_taken.set()
        return socket

    def _note(self, unseen: deque[tuple[int, float]], time_s: float) -> None:
        while any(made_s == time_s for _, made_s in unseen):
            number, made_s = unseen.popleft()
            self._taken = max(self._taken, number)
            if made_s == time_s:
                return

    async def _take(self, socket: web.WebSocketResponse, data: str) -> None:
        try:
            asked = msgspec.json.decode(data, type=Command | Drive | Seen)
        except msgspec.DecodeError as error:
            self.refused.append(f"{error}: {data}")
            return
        if isinstance(asked, Seen):
            self.seen.append(asked.time_s)
            self._note(self._open[socket], asked.time_s)
            self._was_taken.set()
            await socket.send_str(msgspec.json.encode(SeenView(time_s=asked.time_s, at_s=self._now_s())).decode())
            return
        self.ids.append(asked.id)
        if isinstance(asked, Drive):
            self.drives.append(asked)
            return
        self.commands.append(asked)
        self.script.react(asked)
        answer = self.script.answers.get(asked.act, (True, "done"))
        if answer is not None:
            reply = ReplyView(id=asked.id, is_accepted=answer[0], text=answer[1])
            await socket.send_str(msgspec.json.encode(reply).decode())


def _file(path: Path, kind: str) -> web.Response:
    headers = {"Content-Security-Policy": CSP, "X-Content-Type-Options": "nosniff", "Cache-Control": "no-cache"}
    return web.Response(body=path.read_bytes(), content_type=kind, charset="utf-8", headers=headers)
