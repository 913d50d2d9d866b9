# SPDX-License-Identifier: MIT
"""Talking to the server over a socket."""

import asyncio
import base64
from collections.abc import Callable
from typing import Any

from aiohttp import ClientSession, ClientWebSocketResponse
from yarl import URL

from tests.deploy.station.web.serving import Served, receive
from tests.patience import PATIENCE_S


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - what is waited for is a script's, which has no events
            await asyncio.sleep(0.005)


def reader_of(writer: asyncio.StreamWriter) -> asyncio.ReadTransport:
    transport: asyncio.BaseTransport = writer.transport
    assert isinstance(transport, asyncio.ReadTransport)
    return transport


async def asked(socket: ClientWebSocketResponse, message: str) -> dict[str, Any]:
    """The reply to a message."""
    await socket.send_str(message)
    return await receive(socket, "reply")


def upgrade(here: Served, client: ClientSession, key: bytes = b"the key of 16 by") -> bytes:
    cookies = client.cookie_jar.filter_cookies(URL(here.url))
    cookie = "; ".join(f"{name}={morsel.value}" for name, morsel in cookies.items())
    return (
        f"GET /socket HTTP/1.1\r\nHost: 127.0.0.1:{here.port}\r\nOrigin: {here.url}\r\nCookie: {cookie}\r\n"
        "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        f"Sec-WebSocket-Key: {base64.b64encode(key).decode()}\r\n\r\n"
    ).encode()
