# SPDX-License-Identifier: MIT
"""A proxy that is a slow link: so many bytes a second, latency, gaps, and a buffer for what waits."""

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator
from typing import Final, NamedTuple

_PACKET_BYTES: Final = 1400


class LinkQuality(NamedTuple):
    """Of each direction.

    Attributes:
        bytes_per_s: How much it carries.
        latency_s: How long each packet is on the way, beside its own length.
        gap_s: For how long it carries nothing, s, at the end of each `period_s`.
    """

    bytes_per_s: float
    latency_s: float
    gap_s: float = 0.0
    period_s: float = 10.0

    def opens_s(self, now_s: float) -> float:
        """When it carries something at the earliest, at `now_s` or later."""
        begun_s = now_s - now_s % self.period_s
        return now_s if now_s < begun_s + self.period_s - self.gap_s else begun_s + self.period_s


class _Direction:
    """Carries bytes from one end to the other; its buffer has no end, as those of modems seem to have none."""

    def __init__(self, quality: LinkQuality, writer: asyncio.StreamWriter) -> None:
        self._quality = quality
        self._writer = writer
        self._loop = asyncio.get_running_loop()
        self._free_s = 0.0
        self._packets: deque[bytes] = deque()

    def carry(self, content: bytes) -> None:
        for begin in range(0, len(content), _PACKET_BYTES):
            packet = content[begin : begin + _PACKET_BYTES]
            begins_s = self._quality.opens_s(max(self._free_s, self._loop.time()))
            self._free_s = begins_s + len(packet) / self._quality.bytes_per_s
            self._packets.append(packet)
            self._loop.call_at(self._free_s + self._quality.latency_s, self._deliver)

    def _deliver(self) -> None:
        packet = self._packets.popleft()
        if not self._writer.is_closing():
            self._writer.write(packet)


async def _pump(reader: asyncio.StreamReader, direction: _Direction) -> None:
    while content := await reader.read(65536):
        direction.carry(content)


@contextlib.asynccontextmanager
async def slow_link(quality: LinkQuality, port: int) -> AsyncIterator[int]:
    """A link to a port of loopback; gives the port of its near end."""

    async def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", port)
        pumps = (
            asyncio.ensure_future(_pump(reader, _Direction(quality, far_writer))),
            asyncio.ensure_future(_pump(far_reader, _Direction(quality, writer))),
        )
        with contextlib.suppress(ConnectionError):
            await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
        for pump in pumps:
            pump.cancel()
        for end in (writer, far_writer):
            end.transport.abort()

    server = await asyncio.start_server(connected, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()
