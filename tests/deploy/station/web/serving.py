# SPDX-License-Identifier: MIT
"""A server of a scripted station in this process, and browsers that are rude."""

import asyncio
import contextlib
import zlib
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import aiohttp
import msgspec

from segway_ecc.deploy.station.archive_client import ArchiveClient, Progress
from segway_ecc.deploy.station.web.access import Access, Role, new_access
from segway_ecc.deploy.station.web.downloads import Bundle
from segway_ecc.deploy.station.web.server import Server, ServerSettings
from segway_ecc.deploy.station.web.site_address import bind, site_address_of
from segway_ecc.deploy.support.archive_files import LogFile
from segway_ecc.node.errors import NobodyListensError
from tests.deploy.station.web.scripted_station import ScriptedStation
from tests.patience import PATIENCE_S

HEARTBEAT_S = 0.05


class NoArchive(ArchiveClient):
    """Of robots that offer no logs."""

    def __init__(self) -> None:
        """Keep nothing, and begin no thread."""

    def logs(self, robot: str) -> Sequence[LogFile]:
        raise NobodyListensError(robot)

    def begin(self, robot: str, name: str) -> None:
        raise NobodyListensError(f"{robot} {name}")

    def progress(self, robot: str) -> Mapping[str, Progress]:
        assert robot
        return {}

    def open(self, robot: str, name: str) -> tuple[int, int]:
        raise FileNotFoundError(robot, name)

    def close(self) -> None:
        pass


def _no_bundle(robot: str) -> IO[bytes]:
    raise NobodyListensError(robot)


class Served(NamedTuple):
    """A running station."""

    station: ScriptedStation
    server: Server
    port: int
    folder: Path
    tokens: Mapping[Role, str]
    scheme: str

    @property
    def url(self) -> str:
        return f"{self.scheme}://127.0.0.1:{self.port}"

    def refused(self) -> Mapping[str, int]:
        return dict(self.server.shared.refusals.most_common())

    async def audit(self) -> list[dict[str, Any]]:
        """What stands in the audit log, once it is written."""
        await asyncio.sleep(0.1)
        return [msgspec.json.decode(line) for line in (self.folder / "audit.jsonl").read_bytes().splitlines()]


@contextlib.asynccontextmanager
async def served(
    folder: Path,
    *,
    tokens: bool = False,
    bundle: Bundle = _no_bundle,
    station: ScriptedStation | None = None,
    **more: Any,
) -> AsyncIterator[Served]:
    """A station that is served, and whose pictures come twenty times a second."""
    station = station or ScriptedStation()
    sockets = bind("127.0.0.1", 0)
    scheme = "https" if more.get("tls") else "http"
    place = more.pop("place", None) or site_address_of(sockets, scheme, [])
    access: Access | None = None
    shown: Mapping[Role, str] = {}
    if tokens:
        access, shown = new_access()
    logs = folder / "logs"
    logs.mkdir(exist_ok=True)
    place = place._replace(port=sockets[0].getsockname()[1])
    archive = more.pop("archive", None) or NoArchive()
    settings = ServerSettings(place, folder, logs, "0", bundle, archive, access, **more)
    async with Server(station, sockets, settings) as server:
        ticking = asyncio.create_task(_tick(station))
        try:
            yield Served(station, server, settings.place.port, folder, shown, scheme)
        finally:
            ticking.cancel()


async def _tick(station: ScriptedStation) -> None:
    while True:
        station.tick()
        await asyncio.sleep(HEARTBEAT_S)


@contextlib.asynccontextmanager
async def browser(
    here: Served, name: str = "", role: Role | None = None, *, ssl: Any = True, address: str = "127.0.0.1"
) -> AsyncIterator[aiohttp.ClientSession]:
    """A client with a cookie jar that sends Origin as a browser does; logged in where a role is given."""
    connector = aiohttp.TCPConnector(ssl=ssl, local_addr=(address, 0))
    jar = aiohttp.CookieJar(unsafe=True)  # for an address instead of a name
    headers = {"Origin": here.url}
    async with aiohttp.ClientSession(here.url, connector=connector, cookie_jar=jar, headers=headers) as client:
        if role is not None or name:
            token = here.tokens[role] if role is not None else ""
            async with client.post("/login", json={"name": name, "token": token}) as answer:
                assert answer.status == 204, await answer.text()
        yield client


async def receive(socket: aiohttp.ClientWebSocketResponse, kind: str) -> dict[str, Any]:
    """The next message of a kind; of a picture the station is told that it arrived, as the page does."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            message = await socket.receive()
            assert message.type in {aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY}, message
            is_text = message.type is aiohttp.WSMsgType.TEXT
            decoded: dict[str, Any] = msgspec.json.decode(message.data if is_text else zlib.decompress(message.data))
            if decoded["kind"] == "fleet":
                await socket.send_str(seen(decoded["time_s"]))
            if decoded["kind"] == kind:
                return decoded


async def closed(socket: aiohttp.ClientWebSocketResponse) -> tuple[int | None, str]:
    """Why the other side closed: the code and the reason."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            message = await socket.receive()
            if message.type is aiohttp.WSMsgType.CLOSE:
                return message.data, str(message.extra)
            if message.type in {aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.ERROR, aiohttp.WSMsgType.CLOSING}:
                return socket.close_code, ""


def seen(time_s: float) -> str:
    return msgspec.json.encode({"kind": "seen", "time_s": time_s}).decode()


def command(number: int, act: str = "arm", **fields: Any) -> str:
    return msgspec.json.encode({"kind": "command", "id": number, "robot": "/alice", "act": act, **fields}).decode()


def drive(number: int, linear: float, angular: float = 0.0) -> str:
    fields = {"kind": "drive", "id": number, "robot": "/alice", "linear": linear, "angular": angular}
    return msgspec.json.encode(fields).decode()
