"""Serves until it is told to end."""

import asyncio
import contextlib
import socket
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import TypeAlias

from segway_ecc.deploy.station.web.interfaces import Robots
from segway_ecc.deploy.station.web.server import Server, ServerSettings

Stoppable: TypeAlias = Callable[[Callable[[str], None]], AbstractContextManager[None]]
"""Given what ends us, a context in which signals do."""


def serve(
    robots: Robots,
    sockets: Sequence[socket.socket],
    settings: ServerSettings,
    stoppable: Stoppable,
    ready: Callable[[], None],
) -> Mapping[str, object]:
    """Serve until a signal; return what there was to count.

    Args:
        robots: The robots.
        sockets: Bound, and ours from now on.
        settings: How.
        stoppable: Lets signals end us.
        ready: Called once browsers are let in.
    """
    return asyncio.run(_serve(Server(robots, sockets, settings), stoppable, ready))


async def _serve(server: Server, stoppable: Stoppable, ready: Callable[[], None]) -> Mapping[str, object]:
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    causes: list[str] = []

    def end(cause: str) -> None:
        causes.append(cause)
        with contextlib.suppress(RuntimeError):  # a second signal, after the end
            loop.call_soon_threadsafe(ended.set)

    with stoppable(end):
        async with server:
            ready()
            await ended.wait()
    return {"ended_by": causes[0], **server.report()}
