# SPDX-License-Identifier: MIT
"""Logs and support bundles for download, and logs as a page; every text in it may be a stranger's."""

import asyncio
import contextlib
import datetime as dt
import html
import os
import re
import urllib.parse
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO, Final, NamedTuple, TypeAlias

from aiohttp import web

from segway_ecc.deploy.station.archive_client import ArchiveClient, Progress
from segway_ecc.deploy.station.views import FleetView
from segway_ecc.deploy.station.web.shared import Cause, RefusedRequestError, json_response
from segway_ecc.deploy.support.archive_files import LogFile, logs_in, open_log
from segway_ecc.node.errors import NodeError

Bundle: TypeAlias = Callable[[str], IO[bytes]]
"""Makes the support bundle of a robot, a zip, as an open file with a descriptor, which is the caller's to close; it may
take a minute, and is called in a thread of its own."""
_PIECE_BYTES: Final = 256 * 1024
_NOT_PLAIN: Final = re.compile(r"[^A-Za-z0-9._-]")
_AT_ONCE: Final = 8
_MOST_LISTED: Final = 20
_FRESH_NS: Final = 2_000_000_000
_NS: Final = 1e-9
_LATEST_S: Final = 253_402_300_799  # the end of the year 9999
_REFRESH: Final = '<meta http-equiv="refresh" content="2">'
_PAGE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>Recorded logs</title><link rel="icon" href="/static/icon.svg" type="image/svg+xml">{}
<link rel="stylesheet" href="/static/theme.css"><link rel="stylesheet" href="/static/style.css">
</head><body><main><h1>Recorded logs</h1>
<p><a href="/">Base station</a> <a href="/logs">All logs</a></p>{}</main></body></html>
"""
_SECTION: Final = "<section><h2>{}</h2>{}</section>"
_TABLE: Final = """<table>
<thead><tr><th scope="col">Log</th><th scope="col">Bytes</th><th scope="col">Written, UTC</th>{}</tr></thead>
<tbody>{}</tbody></table>"""
_ROW: Final = '<tr><th scope="row">{}</th><td>{}</td><td>{}</td>{}</tr>'
_LINK: Final = '<a href="{}" download>{}</a>'
_LOG_ENDING: Final = ".mcap"
_PLAY: Final = '<a class="play-log" href="{}" aria-label="Play {}">Play</a>'
_PLAY_HEAD: Final = '<th scope="col">In the browser</th>'
_BUTTON: Final = '<form method="post" action="{}"><button aria-label="{} {}">{}</button></form>'
_BAR: Final = '<progress aria-label="{}" value="{}" max="{}"></progress> {:.0f} %'


class RobotLogs(NamedTuple):
    """The logs of a robot.

    Attributes:
        error: Why it offers nothing.
        progress: Of what is fetched, by name.
        here: The logs that lie in the station's folder whole, by name: when each was written, ns since the Unix epoch.
    """

    robot: str
    logs: Sequence[LogFile] = ()
    error: str = ""
    progress: Mapping[str, Progress] = {}
    here: Mapping[str, LogFile] = {}

    def as_json(self) -> dict[str, object]:
        """As it is sent."""
        logs = []
        for log in self.logs:
            progress = self.progress.get(log.name)
            state, fetched, why = "done" if log == self.here.get(log.name) else "on the robot", 0, ""
            if progress is not None and progress.state != "done":
                state, fetched, why = progress.state, progress.fetched, progress.why
            logs.append({**log._asdict(), "state": state, "fetched": fetched, "why": why})
        return {"robot": self.robot, "logs": logs, "error": self.error}


class Downloads:
    """Serves the logs of the robots in the newest picture, on the station and on the robots, and support bundles."""

    def __init__(
        self,
        folder: Path,
        bundle: Bundle,
        archive: ArchiveClient,
        fleet: Callable[[], FleetView],
        clock_ns: Callable[[], int],
    ) -> None:
        """Serve the logs of a folder, bundles that `bundle` makes, and logs that `archive` fetches from robots."""
        self._folder = folder
        self._bundle = bundle
        self._archive = archive
        self._robots = RobotArchives(archive, clock_ns)
        self._fleet = fleet
        self._making = asyncio.Lock()

    async def logs(self, request: web.Request, *, may_fetch: bool) -> web.Response:
        """The logs here and on the robots: as a page, or as JSON where that is accepted."""
        fleet = self._fleet()
        own = await asyncio.to_thread(logs_in, self._folder, _names(fleet))
        robots = await self._robots.of_all(fleet)
        if _wants_json(request):
            return json_response(
                {"logs": [log._asdict() for log in own], "robots": [each.as_json() for each in robots]}
            )
        return web.Response(text=logs_page(own, robots, may_fetch=may_fetch), content_type="text/html")

    async def robot_logs(self, request: web.Request, *, may_fetch: bool) -> web.Response:
        """The logs that a robot offers."""
        logs = await self._robots.of(self._known(request))
        status = 503 if logs.error else 200
        if _wants_json(request):
            return json_response(logs.as_json(), status)
        return web.Response(text=logs_page(None, [logs], may_fetch=may_fetch), content_type="text/html", status=status)

    def open_log(self, request: web.Request) -> int:
        """The descriptor of the log that a request names: one of the station, or of a robot that was fetched.

        Raises:
            FileNotFoundError: There is none that may be seen.
            RefusedRequestError: The robot is not known.
        """
        name = request.match_info["name"]
        if "robot" in request.match_info:
            return self._archive.open(self._known(request), name)[0]
        return open_log(self._folder, name, _names(self._fleet()))[0]

    async def log(self, request: web.Request) -> web.StreamResponse:
        """One log of the station, as long as it was at the request."""
        name = request.match_info["name"]
        try:
            file, size = await asyncio.to_thread(open_log, self._folder, name, _names(self._fleet()))
        except FileNotFoundError:
            raise RefusedRequestError(Cause.NOT_FOUND) from None
        return await _send(request, file, size, _attachment("", name))

    async def robot_log(self, request: web.Request) -> web.StreamResponse:
        """One log of a robot that was fetched."""
        robot, name = self._known(request), request.match_info["name"]
        try:
            file, size = await asyncio.to_thread(self._archive.open, robot, name)
        except FileNotFoundError:
            text = f"this log is not on the station; see {path_of(robot)}, and fetch it first (POST to this address)"
            return json_response({"error": text}, 404)
        return await _send(request, file, size, _attachment(robot, name))

    async def fetch(self, request: web.Request) -> web.Response:
        """Begin to fetch a log from a robot."""
        robot, name = self._known(request), request.match_info["name"]
        logs: RobotLogs = await self._robots.of(robot)
        why = logs.error
        if not why and all(log.name != name for log in logs.logs):
            raise RefusedRequestError(Cause.NOT_FOUND)
        if not why:
            try:
                await asyncio.to_thread(self._archive.begin, robot, name)
            except NodeError as error:
                why = str(error)
        if _wants_json(request) or why:
            return json_response({"error": why} if why else {"see": path_of(robot)}, 503 if why else 202)
        return web.Response(status=303, headers={"Location": path_of(robot)})

    async def bundle(self, request: web.Request) -> web.StreamResponse:
        """The support bundle of a robot that is known; one is made at a time."""
        robot = self._known(request)
        async with self._making:
            stream = await asyncio.to_thread(self._bundle, robot)
        with stream:
            file = os.dup(stream.fileno())
        os.lseek(file, 0, os.SEEK_SET)
        size = os.fstat(file).st_size
        response = _attachment(robot, "support.zip")
        response.content_type = "application/zip"
        return await _send(request, file, size, response)

    def _known(self, request: web.Request) -> str:
        robot = request.match_info["robot"]
        if all(each.robot != robot for each in self._fleet().robots):
            raise RefusedRequestError(Cause.NOT_FOUND)
        return robot


def _names(fleet: FleetView) -> frozenset[str]:
    """What the robots of a picture are called in their files, and so in their logs' names."""
    return frozenset(robot.name for robot in fleet.robots)


async def _send(request: web.Request, file: int, size: int, response: web.StreamResponse) -> web.StreamResponse:
    try:
        response.content_length = size
        await response.prepare(request)
        while size > 0 and (piece := await asyncio.to_thread(_read, file, min(size, _PIECE_BYTES))):
            await response.write(piece)
            size -= len(piece)
    finally:
        os.close(file)
    if size:
        # It was shortened meanwhile: the other end must not take it for whole.
        response.force_close()
    return response


def _read(file: int, size: int) -> bytes:
    """Some bytes; none where the disk fails, as at the end: half of the answer has been sent."""
    try:
        return os.read(file, size)
    except OSError:
        return b""


def _attachment(robot: str, name: str) -> web.StreamResponse:
    """A response that is saved and never shown, whatever is in it, named after the robot, if any, and the file."""
    prefix = f"{robot.strip('/') or 'robot'}-" if robot else ""
    response = web.StreamResponse()
    response.content_type = "application/octet-stream"
    response.headers["Content-Disposition"] = f'attachment; filename="{_NOT_PLAIN.sub("_", prefix + name)}"'
    return response


def _wants_json(request: web.Request) -> bool:
    return "application/json" in request.headers.get("Accept", "")


class RobotArchives:
    """Lists the logs of robots, each at most once at a time and every two seconds, however many browsers ask."""

    def __init__(self, archive: ArchiveClient, clock_ns: Callable[[], int]) -> None:
        self._archive = archive
        self._clock_ns = clock_ns
        # Of its own: what waits for robots must not delay what reads files.
        self._pool = ThreadPoolExecutor(_AT_ONCE, "robot-logs")
        self._asking: dict[str, asyncio.Task[RobotLogs]] = {}
        self._asked: dict[str, tuple[int, RobotLogs]] = {}

    async def of_all(self, fleet: FleetView) -> Sequence[RobotLogs]:
        """The logs of every living robot."""
        names = [robot.robot for robot in fleet.robots if robot.is_alive][:_MOST_LISTED]
        return await asyncio.gather(*(self.of(name) for name in names))

    async def of(self, robot: str) -> RobotLogs:
        """The logs of one robot."""
        asked = self._asked.get(robot)
        if asked is None or self._clock_ns() - asked[0] > _FRESH_NS:
            task = self._asking.get(robot)
            if task is None:
                task = self._asking[robot] = asyncio.create_task(self._ask(robot))
            await asyncio.shield(task)
            asked = self._asked[robot]
        logs = asked[1]
        here = await asyncio.to_thread(_here, self._archive, robot, [log.name for log in logs.logs])
        return logs._replace(progress=self._archive.progress(robot), here=here)

    async def _ask(self, robot: str) -> RobotLogs:
        try:
            logs = await asyncio.get_running_loop().run_in_executor(self._pool, self._archive.logs, robot)
            found = RobotLogs(robot, logs)
        except NodeError as error:
            found = RobotLogs(robot, error=str(error))
        finally:
            del self._asking[robot]
        self._asked[robot] = (self._clock_ns(), found)
        return found


def _here(archive: ArchiveClient, robot: str, names: Iterable[str]) -> Mapping[str, LogFile]:
    found = {}
    for name in names:
        with contextlib.suppress(FileNotFoundError):
            file, size = archive.open(robot, name)
            changed_ns = os.fstat(file).st_mtime_ns
            os.close(file)
            found[name] = LogFile(name, size, changed_ns)
    return found


def path_of(robot: str, name: str = "") -> str:
    """Where the logs of a robot are, or one of them."""
    path = f"/robots/{urllib.parse.quote(robot, safe='')}/logs"
    return f"{path}/{urllib.parse.quote(name, safe='')}" if name else path


def logs_page(logs: Sequence[LogFile] | None, robots: Sequence[RobotLogs], *, may_fetch: bool) -> str:
    """The page: the station's own logs, where they are given, and those of robots."""
    sections = []
    if logs is not None:
        own = [
            (
                log,
                _LINK.format(f"/logs/{urllib.parse.quote(log.name, safe='')}", _text(log)),
                f"<td>{_play('', log)}</td>",
            )
            for log in logs
        ]
        sections.append(_SECTION.format("On this station", _table(own, _PLAY_HEAD)))
    for robot in robots:
        rows = []
        for log in robot.logs:
            is_here = log.name in robot.here
            name = _LINK.format(path_of(robot.robot, log.name), _text(log)) if is_here else _text(log)
            play = _play(robot.robot, log) if is_here else ""
            rows.append((log, name, f"<td>{_act(robot, log, may_fetch)}</td><td>{play}</td>"))
        head = f'<th scope="col">Fetch</th>{_PLAY_HEAD}'
        table = f"<p>{html.escape(robot.error)}</p>" if robot.error else _table(rows, head)
        sections.append(_SECTION.format(f"On robot {html.escape(robot.robot)}", table))
    is_going_on = any(progress.is_going_on for each in robots for progress in each.progress.values())
    return _PAGE.format(_REFRESH if is_going_on else "", "".join(sections))


def _table(rows: Sequence[tuple[LogFile, str, str]], more: str) -> str:
    """Rows of a log, its name as HTML and further cells; `more` heads these."""
    if not rows:
        return "<p>There are none.</p>"
    text = ""
    for log, name, cells in rows:
        written = dt.datetime.fromtimestamp(min(log.changed_ns * _NS, _LATEST_S), dt.UTC).strftime("%Y-%m-%d %H:%M:%S")
        text += _ROW.format(name, log.size, written, cells)
    return _TABLE.format(more, text)


def _act(robot: RobotLogs, log: LogFile, may_fetch: bool) -> str:  # noqa: FBT001 - passed through
    progress = robot.progress.get(log.name)
    if progress is not None and progress.is_going_on:
        share = 100.0 * progress.fetched / max(progress.size, 1)
        return _BAR.format(_text(log), progress.fetched, max(progress.size, 1), share)
    if log == robot.here.get(log.name):
        return "here"
    failed = progress is not None and progress.state == "failed"
    word = "Try again" if failed else "Fetch anew" if log.name in robot.here else "Fetch"
    button = _BUTTON.format(path_of(robot.robot, log.name), word, _text(log), word) if may_fetch else ""
    return f"{html.escape(progress.why)} {button}" if failed and progress is not None else button


def player_path(name: str, robot: str = "") -> str:
    """Where the page is that plays a log; without a robot, one of the station's own."""
    return f"/log#{urllib.parse.urlencode({'robot': robot, 'log': name} if robot else {'log': name}, safe='')}"


def _play(robot: str, log: LogFile) -> str:
    """A link that plays a log; nothing beside what is none."""
    if not log.name.endswith(_LOG_ENDING):
        return ""
    return _PLAY.format(html.escape(player_path(log.name, robot)), _text(log))


def _text(log: LogFile) -> str:
    return html.escape(log.name)
