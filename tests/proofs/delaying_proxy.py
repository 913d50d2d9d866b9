# SPDX-License-Identifier: MIT
"""A slow network: what passes arrives a fixed time later, in both directions, however much it is."""

import asyncio
import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Final

_PIECE: Final = 65536
_BEGINS_WITHIN_S: Final = 10.0


class DelayingProxy:
    """Passes TCP connections on, each byte `delay_s` after it came. All its methods run in the loop's thread."""

    def __init__(self, to_port: int, delay_s: float) -> None:
        self._to_port = to_port
        self._delay_s = delay_s
        self._writers: list[asyncio.StreamWriter] = []
        self._tasks: set[asyncio.Task[None]] = set()

    async def serve(self, address: str) -> None:
        """Listen on another address with the same port: the station knows itself by its port."""
        self._server = await asyncio.start_server(self._connected, address, self._to_port)

    async def close(self) -> None:
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for writer in self._writers:
            writer.transport.abort()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there_reader, there_writer = await asyncio.open_connection("127.0.0.1", self._to_port)
        self._writers += [writer, there_writer]
        for ends in ((reader, there_writer), (there_reader, writer)):
            task = asyncio.create_task(self._pass_on(*ends))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        later = asyncio.get_running_loop().call_later
        with contextlib.suppress(ConnectionError):
            while piece := await reader.read(_PIECE):
                later(self._delay_s, _quietly(writer.write), piece)
        later(self._delay_s, _quietly(lambda _: writer.close()), b"")


def _quietly(function: Callable[[bytes], None]) -> Callable[[bytes], None]:
    def call(piece: bytes) -> None:
        with contextlib.suppress(RuntimeError, ConnectionError):  # the other side is gone
            function(piece)

    return call


@contextlib.contextmanager
def slow_way_to(port: int, address: str, delay_s: float) -> Iterator[None]:
    """A proxy in a thread of its own, at `address` and the same port."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name="slow network", daemon=True)
    thread.start()
    proxy = DelayingProxy(port, delay_s)
    try:
        asyncio.run_coroutine_threadsafe(proxy.serve(address), loop).result(_BEGINS_WITHIN_S)
        yield
    finally:
        asyncio.run_coroutine_threadsafe(proxy.close(), loop).result(_BEGINS_WITHIN_S)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(_BEGINS_WITHIN_S)
        loop.close()
