# SPDX-License-Identifier: MIT
"""Browsers that ask too much, or take nothing."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest
from aiohttp import ClientSession, ClientWebSocketResponse, WSServerHandshakeError

from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.station.web.limits import Limits, Rate
from tests.deploy.station.web.scripted_station import full_robot
from tests.deploy.station.web.serving import Served, browser, closed, command, drive, receive, served
from tests.deploy.station.web.socket_helpers import asked, reader_of, until, upgrade

Tried = Callable[[str, str], None]
OPERATOR, VIEWER = Role.OPERATOR, Role.VIEWER


@contextlib.asynccontextmanager
async def _connected(folder: Path) -> AsyncIterator[tuple[Served, ClientWebSocketResponse]]:
    """A station whose limits see no time pass, and an operator's socket to it."""
    async with (
        served(folder, clock_ns=lambda: 0) as here,
        browser(here, "ann") as client,
        client.ws_connect("/socket") as socket,
    ):
        yield here, socket


def test_too_many_mistakes_close_the_socket_with_the_reason(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with _connected(tmp_path) as (here, socket):
            for _ in range(21):
                await socket.send_str("rubbish")
            code, reason = await closed(socket)
            assert (code, reason) == (1008, "too many messages were refused, the last: malformed")
            assert here.refused() == {"malformed": 21}
        tried("21 malformed messages", "the socket is closed with 1008 and the reason")

    asyncio.run(scenario())


def test_commands_have_a_limit_that_leaves_stops_alone(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with _connected(tmp_path) as (here, socket):
            accepted = [(await asked(socket, command(number)))["is_accepted"] for number in range(1, 41)]
            assert accepted == [True] * 30 + [False] * 10
            assert (await asked(socket, command(41, "stop")))["is_accepted"]
            assert here.refused() == {"command rate": 10}
        tried("40 commands at once", "30 are carried out, 10 refused with a reply; a stop still goes through")

    asyncio.run(scenario())


def test_set_points_have_a_limit_that_leaves_rest_alone(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with _connected(tmp_path) as (here, socket):
            for number in range(1, 101):
                await socket.send_str(drive(number, 0.5))
            await socket.send_str(drive(101, 0.0))
            await until(lambda: len(here.station.drives) == 31)
            assert here.station.drives[-1][1].linear == 0.0
            assert here.refused() == {"drive rate": 70}
        tried("100 set-points at once", "30 are passed on; one of zero always is")

    asyncio.run(scenario())


def test_a_flood_on_one_socket_closes_it(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with _connected(tmp_path) as (here, socket):
            for number in range(1, 425):
                await socket.send_str(command(number, "stop"))
            code, reason = await closed(socket)
            assert (code, reason) == (1008, "too many messages were refused, the last: message rate")
            assert here.refused()["message rate"] >= 21
        tried("424 messages at once on one socket", "the socket is closed with 1008 and the reason")

    asyncio.run(scenario())


def test_sockets_are_bounded_in_all_and_for_each_address(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path, limits=Limits(sockets=5, sockets_each=3)) as here,
            browser(here, "ann") as ann,
            browser(here, "bob", address="127.0.0.2") as bob,
        ):
            sockets = [await ann.ws_connect("/socket") for _ in range(3)]
            await _refused_socket(ann, 503)
            sockets += [await bob.ws_connect("/socket") for _ in range(2)]
            await _refused_socket(bob, 503)
            assert here.refused() == {"too many sockets": 2}
            await sockets[0].close()
            sockets.append(await bob.ws_connect("/socket"))
            for socket in sockets:
                await socket.close()
        tried("more sockets than an address, or all, may have", "refused with 503, counted as too many sockets")

    asyncio.run(scenario())


async def _refused_socket(client: ClientSession, status: int) -> None:
    with pytest.raises(WSServerHandshakeError) as refused:
        await client.ws_connect("/socket")
    assert refused.value.status == status


def test_stuck_browser_does_not_block_others_and_is_disconnected(tmp_path: Path, tried: Tried) -> None:
    now = [0]

    async def scenario() -> None:
        limits = Limits(requests=Rate(1.0, 100))
        async with (
            served(tmp_path, tokens=True, clock_ns=lambda: now[0], limits=limits) as here,
            browser(here, "ann", OPERATOR) as client,
            client.ws_connect("/socket") as good,
        ):
            _, writer = await asyncio.open_connection("127.0.0.1", here.port, limit=1)
            writer.write(upgrade(here, client))
            await until(lambda: len(here.server.hub) == 2)
            reader_of(writer).pause_reading()
            here.station.robots = [full_robot(f"/robot{number}") for number in range(60)]
            for _ in range(11):
                await receive(good, "fleet")
                now[0] += 1_000_000_000
            await until(lambda: len(here.server.hub) == 1)
            assert here.refused() == {"too slow": 1}
            await receive(good, "fleet")
            writer.transport.abort()
        tried("a browser that stops reading", "others get every picture; it is cut after 10 s")

    asyncio.run(scenario())


def test_a_browser_that_answers_no_ping_is_gone(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path, tokens=True, limits=Limits(ping_s=0.2)) as here,
            browser(here, "ann", OPERATOR) as client,
        ):
            _, writer = await asyncio.open_connection("127.0.0.1", here.port)
            writer.write(upgrade(here, client))
            await until(lambda: len(here.server.hub) == 1)
            await until(lambda: here.station.gone == ["ann"])
            assert len(here.server.hub) == 0
            writer.transport.abort()
        tried("a browser that answers no ping", "cut after 15 s, and its control ends")

    asyncio.run(scenario())


def test_a_browser_that_leaves_too_many_events_unread_is_sent_away(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with served(tmp_path, tokens=True) as here, browser(here, "ann", OPERATOR) as client:
            _, writer = await asyncio.open_connection("127.0.0.1", here.port, limit=1)
            writer.write(upgrade(here, client))
            await until(lambda: len(here.server.hub) == 1)
            reader_of(writer).pause_reading()
            for _ in range(3000):
                here.station.happen("x" * 10_000)
            await until(lambda: here.refused() == {"too slow": 1})
            writer.transport.abort()
            await until(lambda: here.station.gone == ["ann"])
        tried("a browser that leaves 1,000 events unread", "cut, counted as too slow")

    asyncio.run(scenario())
