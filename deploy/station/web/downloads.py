"""Logs and support bundles, to be fetched."""

import asyncio
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import IO, Final, NamedTuple

from aiohttp import web

from segway_ecc.deploy.station.views import FleetView
from segway_ecc.deploy.station.web.interfaces import Archive, Bundle
from segway_ecc.deploy.station.web.log_pages import RobotLogs, logs_page, path_of
from segway_ecc.deploy.station.web.refusals import Cause
from segway_ecc.deploy.station.web.responses import RefusedRequestError, json_answer
from segway_ecc.deploy.station.web.robot_logs import RobotArchives, as_json
from segway_ecc.deploy.support.log_folder import logs_in, open_log

_PIECE_BYTES: Final = 256 * 1024
_NOT_PLAIN: Final = re.compile(r"[^A-Za-z0-9._-]")


class DownloadSources(NamedTuple):
    """What downloads are made of.

    Attributes:
        folder: Where the station's logs lie.
        bundle: Makes support bundles, or None.
        archive: Fetches logs from robots, or None.
    """

    folder: Path
    bundle: Bundle | None = None
    archive: Archive | None = None


class Downloads:
    """Serves what lies in the station's folder, what robots hand out, and what a function makes."""

    def __init__(self, means: DownloadSources, fleet: Callable[[], FleetView], clock_ns: Callable[[], int]) -> None:
        """Serve the station's logs and those of the robots in the newest picture."""
        self._folder = means.folder
        self._bundle = means.bundle
        self._robots = RobotArchives(means.archive, clock_ns)
        self._fleet = fleet
        self._making = asyncio.Lock()

    async def logs(self, request: web.Request, *, may_fetch: bool) -> web.Response:
        """Which logs there are here and on the robots: a page, or JSON for who asks for that."""
        own = await asyncio.to_thread(logs_in, self._folder)
        robots = await self._robots.of_all(self._fleet())
        if _wants_json(request):
            return json_answer(as_json(own, robots))
        return web.Response(text=logs_page(own, robots, may_fetch=may_fetch), content_type="text/html")

    async def robot_logs(self, request: web.Request, *, may_fetch: bool) -> web.Response:
        """Which logs a robot hands out."""
        logs = await self._robots.of(self._known(request))
        status = 503 if logs.error else 200
        if _wants_json(request):
            return json_answer(logs.as_json(), status)
        return web.Response(text=logs_page(None, [logs], may_fetch=may_fetch), content_type="text/html", status=status)

    async def log(self, request: web.Request) -> web.StreamResponse:
        """One log of the station, as long as it was when it was asked for."""
        name = request.match_info["name"]
        try:
            file, size = await asyncio.to_thread(open_log, self._folder, name)
        except FileNotFoundError:
            raise RefusedRequestError(Cause.NOT_FOUND) from None
        return await _sent(request, file, size, _attachment(_NOT_PLAIN.sub("_", name)))

    async def robot_log(self, request: web.Request) -> web.StreamResponse:
        """One log of a robot that was fetched."""
        robot, name = self._known(request), request.match_info["name"]
        try:
            file, size = await self._robots.open(robot, name)
        except FileNotFoundError:
            text = f"this log is not on the station; see {path_of(robot)}, and fetch it first (POST to this address)"
            return json_answer({"error": text}, 404)
        return await _sent(request, file, size, _attachment(f"{_plain(robot)}-{_NOT_PLAIN.sub('_', name)}"))

    async def fetch(self, request: web.Request) -> web.Response:
        """Begin to fetch a log from a robot."""
        robot, name = self._known(request), request.match_info["name"]
        logs: RobotLogs = await self._robots.of(robot)
        why = logs.error or await self._begun(logs, name)
        if _wants_json(request) or why:
            return json_answer({"error": why} if why else {"see": path_of(robot)}, 503 if why else 202)
        return web.Response(status=303, headers={"Location": path_of(robot)})

    async def bundle(self, request: web.Request) -> web.StreamResponse:
        """The support bundle of a robot that is known; one is made at a time."""
        make = self._bundle
        if make is None:
            text = "this station makes no support bundles; on the robot: segway-ecc log bundle"
            return json_answer({"error": text}, 501)
        robot = self._known(request)
        async with self._making:
            stream = await asyncio.to_thread(make, robot)
        file, size = await asyncio.to_thread(_taken, stream)
        response = _attachment(f"{_plain(robot)}-support.zip")
        response.content_type = "application/zip"
        return await _sent(request, file, size, response)

    async def _begun(self, logs: RobotLogs, name: str) -> str:
        if all(log.name != name for log in logs.logs):
            raise RefusedRequestError(Cause.NOT_FOUND)
        return await self._robots.begin(logs.robot, name)

    def _known(self, request: web.Request) -> str:
        robot = request.match_info["robot"]
        if all(each.robot != robot for each in self._fleet().robots):
            raise RefusedRequestError(Cause.NOT_FOUND)
        return robot


async def _sent(request: web.Request, file: int, size: int, response: web.StreamResponse) -> web.StreamResponse:
    """Send an open file, and close it."""
    try:
        response.content_length = size
        await response.prepare(request)
        while size > 0 and (piece := await asyncio.to_thread(_read, file, min(size, _PIECE_BYTES))):
            await response.write(piece)
            size -= len(piece)
    finally:
        os.close(file)
    if size:
        # It was cut short meanwhile: the other end must not take it for whole.
        response.force_close()
    return response


def _taken(stream: IO[bytes]) -> tuple[int, int]:
    """A descriptor of an open file, at its beginning, and its size; the stream is closed."""
    with stream:
        file = os.dup(stream.fileno())
    os.lseek(file, 0, os.SEEK_SET)
    return file, os.fstat(file).st_size


def _read(file: int, size: int) -> bytes:
    """Some bytes; none where the disk fails, as at the end: half of the answer has been sent."""
    try:
        return os.read(file, size)
    except OSError:
        return b""


def _attachment(name: str) -> web.StreamResponse:
    """It is kept and never shown, whatever is in it."""
    response = web.StreamResponse()
    response.content_type = "application/octet-stream"
    response.headers["Content-Disposition"] = f'attachment; filename="{name}"'
    return response


def _plain(robot: str) -> str:
    return _NOT_PLAIN.sub("_", robot.strip("/")) or "robot"


def _wants_json(request: web.Request) -> bool:
    return "application/json" in request.headers.get("Accept", "")
