# SPDX-License-Identifier: MIT
"""The station sends a picture when the page has those before; what waits meanwhile is the newest, not a queue."""

import asyncio
import contextlib
import zlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import msgspec
from aiohttp import ClientWebSocketResponse, WSMsgType

from segway_ecc.deploy.station.views import FleetView
from segway_ecc.deploy.station.web.pictures import Picture
from tests.deploy.station.web.scripted_station import full_robot
from tests.deploy.station.web.serving import Served, browser, command, receive, seen, served
from tests.deploy.station.web.socket_helpers import asked, until
from tests.patience import PATIENCE_S


@contextlib.asynccontextmanager
async def _connected(
    folder: Path, clock_ns: Callable[[], int]
) -> AsyncIterator[tuple[Served, ClientWebSocketResponse]]:
    async with (
        served(folder, clock_ns=clock_ns) as here,
        browser(here, "ann") as client,
        client.ws_connect("/socket") as socket,
    ):
        yield here, socket


async def _later(here: Served) -> float:
    """Wait until the station has some pictures more; the time of the newest, s."""
    begun_s = here.station.fleet().time_s
    await until(lambda: here.station.fleet().time_s > begun_s + 0.3)
    return here.station.fleet().time_s


async def _until_event(here: Served, socket: ClientWebSocketResponse) -> list[dict[str, Any]]:
    """All that comes before an event that happens now; none of it is acknowledged."""
    here.station.happen("now")
    messages = []
    async with asyncio.timeout(PATIENCE_S):
        while True:
            messages.append(msgspec.json.decode(await socket.receive_str()))
            if messages[-1]["kind"] == "event":
                return messages[:-1]


def _pictures(messages: list[dict[str, Any]]) -> list[float]:
    return [message["time_s"] for message in messages if message["kind"] == "fleet"]


def test_no_second_picture_is_sent_before_the_first_is_seen_and_then_the_newest(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with _connected(tmp_path, lambda: 0) as (here, socket):
            await _later(here)
            (first,) = _pictures(await _until_event(here, socket))
            newest = await _later(here)
            assert _pictures(await _until_event(here, socket)) == []
            await socket.send_str(seen(first))
            answer = msgspec.json.decode(await socket.receive_str())
            assert answer == {"kind": "seen", "time_s": first, "at_s": 0.0}
            assert msgspec.json.decode(await socket.receive_str())["time_s"] >= newest

    asyncio.run(scenario())


def test_two_are_on_the_way_to_a_browser_that_is_quick_and_no_more(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with _connected(tmp_path, lambda: 0) as (here, socket):
            await receive(socket, "fleet")
            await _later(here)
            assert len(_pictures(await _until_event(here, socket))) == 2

    asyncio.run(scenario())


def test_one_is_on_the_way_to_a_browser_that_is_slow(tmp_path: Path) -> None:
    now = [0]

    async def scenario() -> None:
        async with _connected(tmp_path, lambda: now[0]) as (here, socket):
            await _later(here)
            (first,) = _pictures(await _until_event(here, socket))
            now[0] += 400_000_000
            await socket.send_str(seen(first))
            await _later(here)
            messages = await _until_event(here, socket)
            assert messages[0] == {"kind": "seen", "time_s": first, "at_s": 0.4}
            assert len(_pictures(messages)) == 1

    asyncio.run(scenario())


def test_word_of_a_picture_that_was_not_sent_changes_nothing(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with _connected(tmp_path, lambda: 0) as (here, socket):
            await _later(here)
            (first,) = _pictures(await _until_event(here, socket))
            for _ in range(3):
                await socket.send_str(seen(first - 1.0))
            assert (await asked(socket, command(1)))["is_accepted"]
            await _later(here)
            assert await _until_event(here, socket) == []
            assert here.refused() == {}

    asyncio.run(scenario())


def test_pictures_are_compressed_for_who_asks_for_it_and_nothing_else_is(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path) as here,
            browser(here, "ann") as client,
            client.ws_connect("/socket") as plain,
            client.ws_connect("/socket?pictures=deflate") as compressed,
        ):
            here.station.happen("now")
            kinds: set[str] = set()
            while len(kinds) < 3:
                message = await compressed.receive(PATIENCE_S)
                is_text = message.type is WSMsgType.TEXT
                content = message.data if is_text else zlib.decompress(message.data)
                kind = msgspec.json.decode(content)["kind"]
                assert is_text == (kind != "fleet")
                kinds.add(kind)
            assert kinds == {"hello", "event", "fleet"}
            while msgspec.json.decode(await plain.receive_str())["kind"] != "fleet":
                pass

    asyncio.run(scenario())


def test_a_compressed_picture_of_twenty_robots_is_a_tenth_of_it() -> None:
    view = FleetView(time_s=1.0, robots=[full_robot(f"/robot{number}") for number in range(20)])
    picture = Picture(view)
    assert zlib.decompress(picture.deflated) == msgspec.json.encode(view)
    assert len(picture.deflated) < 0.1 * len(picture.encoded)
    assert picture.deflated is picture.deflated, "once for all"


def test_a_browser_that_never_says_that_it_has_a_picture_is_cut(tmp_path: Path) -> None:
    now = [0]

    async def scenario() -> None:
        async with _connected(tmp_path, lambda: now[0]) as (here, socket):
            await _later(here)
            assert len(_pictures(await _until_event(here, socket))) == 1
            now[0] += 9_900_000_000
            await _later(here)
            assert here.refused() == {}
            now[0] += 1_200_000_000
            await until(lambda: here.station.gone == ["ann"])
            assert here.refused() == {"too slow": 1}

    asyncio.run(scenario())
