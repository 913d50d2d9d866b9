# SPDX-License-Identifier: MIT
"""Too much of anything, from one or from many: refused and counted, while others are answered."""

import asyncio
import contextlib
from collections.abc import Callable
from pathlib import Path

import pytest
from yarl import URL

from segway_ecc.deploy.station.web.access import IDLE_S
from segway_ecc.deploy.station.web.limits import Limits, Rate
from tests.deploy.station.web.attempts import OPERATOR
from tests.deploy.station.web.raw_requests import hang_up, login, raw, still_answers
from tests.deploy.station.web.serving import browser, command, served
from tests.deploy.station.web.socket_helpers import asked, until
from tests.patience import PATIENCE_S

Tried = Callable[[str, str], None]
_SLOW_BODY = (
    b"POST /login HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nOrigin: http://127.0.0.1:%d\r\n"
    b"Content-Type: application/json\r\nContent-Length: 4000\r\n\r\n{"
)


@pytest.mark.parametrize(
    "garbage",
    [
        b"\x00" * 100 + b"\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost : x\r\n\r\n",
        b"\x16\x03\x01" * 50 + b"\r\n",
    ],
)
def test_bad_http_is_refused_and_counted(garbage: bytes, tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here) as client:
            assert (await raw(here.port, garbage))[0] == 400
            assert here.refused() == {"bad HTTP": 1}
            await still_answers(client)
        tried(f"no HTTP: {garbage[:12]!r}...", "refused with 400, counted as bad HTTP")

    asyncio.run(scenario())


def test_guessing_tokens_is_slowed_down_for_one_address_and_not_for_another(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with served(tmp_path, tokens=True, clock_ns=lambda: 0) as here:
            async with browser(here, address="127.0.0.2") as client:
                statuses = [await login(client, "guess") for _ in range(8)]
                assert statuses == [403] * 5 + [429] * 3
                assert await login(client, here.tokens[OPERATOR]) == 429
            async with browser(here) as client:
                assert await login(client, here.tokens[OPERATOR]) == 204
            assert here.refused() == {"wrong token": 5, "login rate": 4}
            refusals = [line for line in await here.audit() if line["outcome"] == "refused"]
            assert [line["address"] for line in refusals] == ["127.0.0.2"] * 5
        tried("guessing tokens", "after 5 wrong ones an address waits; the audit log has each")

    asyncio.run(scenario())


def test_guessing_tokens_from_many_addresses_meets_a_limit_for_all(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        limits = Limits(logins=Rate(1.0, 100), all_logins=Rate(1.0, 3))
        async with served(tmp_path, tokens=True, clock_ns=lambda: 0, limits=limits) as here:
            statuses = []
            for number in range(5):
                async with browser(here, address=f"127.0.0.{2 + number}") as client:
                    statuses.append(await login(client, "guess"))
            assert statuses == [403] * 3 + [429] * 2
        tried("guessing tokens from many addresses", "a limit for all of them together")

    asyncio.run(scenario())


def test_ended_session_is_refused(tmp_path: Path, tried: Tried) -> None:
    now = [0]

    async def scenario() -> None:
        async with (
            served(tmp_path, tokens=True, clock_ns=lambda: now[0]) as here,
            browser(here, "ann", OPERATOR) as client,
        ):
            (morsel,) = client.cookie_jar.filter_cookies(URL(here.url)).values()
            cookie = {"Cookie": f"{morsel.key}={morsel.value}"}
            async with client.post("/logout", json={}) as answer:
                assert answer.status == 204
            async with client.get("/logs", headers=cookie) as answer:
                assert answer.status == 401
        async with (
            served(tmp_path, tokens=True, clock_ns=lambda: now[0]) as here,
            browser(here, "ann", OPERATOR) as client,
        ):
            now[0] = (IDLE_S + 1) * 1_000_000_000
            async with client.get("/logs") as answer:
                assert answer.status == 401
        tried("a session after log-out, and one that was idle for half an hour", "refused with 401")

    asyncio.run(scenario())


def test_request_rate_is_limited_per_address(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        limits = Limits(requests=Rate(1.0, 10))
        async with served(tmp_path, limits=limits, clock_ns=lambda: 0) as here:
            async with browser(here, address="127.0.0.2") as client:
                statuses = []
                for _ in range(12):
                    async with client.get("/health") as answer:
                        statuses.append(answer.status)
                assert statuses == [200] * 10 + [429] * 2
            async with browser(here) as client:
                await still_answers(client)
            assert here.refused() == {"request rate": 2}
        tried("more requests than an address may make", "refused with 429; other addresses are answered")

    asyncio.run(scenario())


def test_oldest_of_too_many_connections_of_an_address_gives_way(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        limits = Limits(open_connections_each=5)
        async with served(tmp_path, limits=limits) as here:
            opened = [await _connect(here.port) for _ in range(5)]
            async with browser(here, address="127.0.0.2") as client:
                await still_answers(client)
                assert here.refused() == {"too many connections": 1}
                await _assert_cut(opened[0][0])
                assert not opened[1][0].at_eof()
            for _, each in opened:
                await hang_up(each)
        tried("more open connections than an address may have", "the oldest that is no browser's is cut")

    asyncio.run(scenario())


@pytest.mark.parametrize(
    "begun",
    [
        b"",
        b"GET / HTTP/1.1\r\nHost:",
        _SLOW_BODY,
        b"GET /static/vendor/uplot.js HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n" * 20,
    ],
    ids=["silent", "headers", "body", "unread"],
)
def test_slow_connections_shut_nobody_out_and_stops_go_through(begun: bytes, tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        limits = Limits(open_connections=60, open_connections_each=30)
        async with (
            served(tmp_path, tokens=True, limits=limits) as here,
            browser(here, "ann", OPERATOR) as ann,
            ann.ws_connect("/socket") as socket,
        ):
            slow = [await _connect(here.port, f"127.0.0.{2 + number % 3}") for number in range(90)]
            for _, writer in slow:
                writer.write(begun.replace(b"%d", b"%d" % here.port))
            assert (await asked(socket, command(1, "stop")))["is_accepted"]
            for number in range(3):
                async with (
                    browser(here, f"bob {number}", OPERATOR, address="127.0.0.9") as bob,
                    bob.ws_connect("/socket") as other,
                ):
                    assert (await asked(other, command(1, "stop")))["is_accepted"]
            async with browser(here, "carl", OPERATOR, address="127.0.0.2") as carl:
                await still_answers(carl)
            assert (await asked(socket, command(2, "stop")))["is_accepted"]
            assert [given.act for _, given in here.station.commands] == ["stop"] * 5
            assert here.refused()["too many connections"] >= 30
            for _, each in slow:
                each.transport.abort()
        if not begun:
            text = "others log in and stop, from other addresses and from the same"
            tried("more slow connections than there may be, from three addresses", text)

    asyncio.run(scenario())


def test_response_that_is_not_read_is_given_up(tmp_path: Path, tried: Tried) -> None:
    now = [0]

    async def scenario() -> None:
        async with served(tmp_path, clock_ns=lambda: now[0]) as here:
            reader, writer = await _connect(here.port)
            request = b"GET /static/vendor/uplot.js HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n" % here.port
            writer.write(request * 200)  # more than the sockets' buffers hold
            await asyncio.sleep(0.2)
            now[0] = 31_000_000_000
            await until(lambda: here.refused().get("too slow") == 1)
            writer.transport.abort()
            assert not reader.at_eof()
        tried("a response that is never read", "cut after 30 s")

    asyncio.run(scenario())


async def _connect(port: int, address: str = "127.0.0.2") -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_connection("127.0.0.1", port, local_addr=(address, 0))


async def _assert_cut(reader: asyncio.StreamReader) -> None:
    async with asyncio.timeout(PATIENCE_S):
        with contextlib.suppress(ConnectionError):
            assert await reader.read() == b""


def test_silent_connection_is_closed(tmp_path: Path, tried: Tried) -> None:
    now = [0]

    async def scenario() -> None:
        async with served(tmp_path, clock_ns=lambda: now[0]) as here:
            reader, writer = await _connect(here.port)
            writer.write(b"GET / HTTP/1.1\r\nHost:")
            await asyncio.sleep(0.05)
            now[0] = 11_000_000_000
            async with asyncio.timeout(PATIENCE_S):
                assert await reader.read() == b""
            assert here.refused() == {"silent connection": 1}
            await hang_up(writer)
        tried("a request that is never finished (slowloris)", "closed after 10 s")

    asyncio.run(scenario())
