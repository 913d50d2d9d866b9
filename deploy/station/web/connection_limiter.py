# SPDX-License-Identifier: MIT
"""Accepts connections, or closes them at once: a flood is refused here, before anything is read or decrypted."""

import asyncio
import contextlib
import dataclasses
import socket
import ssl
import struct
from collections import Counter
from collections.abc import Callable
from typing import Final

from segway_ecc.deploy.station.web.limits import Bucket, Buckets, site_of
from segway_ecc.deploy.station.web.shared import Cause, SharedServices

_AT_ONCE: Final = 64
"""Accepted before everything else has its turn."""
_SILENT_NS: Final = 10_000_000_000
_HANDSHAKE_S: Final = 5.0
_RESET: Final = struct.pack("ii", 1, 0)
"""SO_LINGER of no time: the connection is reset, and nothing of it is kept by the kernel (socket(7))."""


@dataclasses.dataclass(slots=True, eq=False)
class _Connection:
    site: str
    at_ns: int
    transport: asyncio.BaseTransport | None = None
    has_request: bool = False


class ConnectionLimiter:
    """Accepts the connections that the limits allow, and passes them to a protocol."""

    def __init__(
        self, protocol: Callable[[], asyncio.BaseProtocol], shared: SharedServices, tls: ssl.SSLContext | None
    ) -> None:
        """Serve with `protocol`, inside TLS where a context is given."""
        self._protocol = protocol
        _, _, self._refusals, self._limits, self._clock_ns = shared
        self._tls = tls
        self._all = Bucket(shared.limits.all_connections, shared.clock_ns())
        self._each = Buckets(shared.limits.connections)
        self._open: set[_Connection] = set()
        self._by_site: Counter[str] = Counter()
        self._sockets: list[socket.socket] = []
        self._tasks: set[asyncio.Task[None]] = set()

    def open(self, listening: socket.socket) -> None:
        """Accept from a listening socket, which is ours from now on."""
        listening.settimeout(0.0)
        self._sockets.append(listening)
        asyncio.get_running_loop().add_reader(listening, self._accept, listening)

    def close(self) -> None:
        """Accept no more connections."""
        for listening in self._sockets:
            asyncio.get_running_loop().remove_reader(listening)
            listening.close()
        self._sockets.clear()

    def on_request(self, transport: asyncio.BaseTransport | None) -> None:
        """Note that a connection has made a whole request."""
        for connection in self._open:
            if connection.transport is transport:
                connection.has_request = True
                return

    def sweep(self) -> None:
        """Discard what is closed, and close what never made a request."""
        now_ns = self._clock_ns()
        for connection in list(self._open):
            transport = connection.transport
            if transport is None:
                continue  # the handshake has a time-out of its own
            if transport.is_closing():
                self._discard(connection)
            elif not connection.has_request and now_ns - connection.at_ns > _SILENT_NS:
                self._refusals[Cause.SILENT_CONNECTION] += 1
                transport.close()

    def _accept(self, listening: socket.socket) -> None:
        for _ in range(_AT_ONCE):
            try:
                accepted, peer = listening.accept()
            except OSError:
                return  # there is none, or it has gone, or we have no file descriptors left: all pass
            site = site_of(str(peer[0]))
            cause = self._refusal(site)
            if cause is not None:
                self._refusals[cause] += 1
                with contextlib.suppress(OSError):
                    accepted.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
                accepted.close()
                continue
            connection = _Connection(site, self._clock_ns())
            self._open.add(connection)
            self._by_site[site] += 1
            task = asyncio.get_running_loop().create_task(self._serve(accepted, connection))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    def _refusal(self, site: str) -> Cause | None:
        now_ns = self._clock_ns()
        each = self._each.of(site, now_ns)
        # An address that is over its own limit uses up nothing of what is everybody's.
        if not each.has_token(now_ns) or not self._all.has_token(now_ns):
            return Cause.CONNECTION_RATE
        if self._is_full(site):
            self.sweep()
            if self._is_full(site):
                return Cause.TOO_MANY_CONNECTIONS
        each.take_token(now_ns)
        self._all.take_token(now_ns)
        return None

    def _is_full(self, site: str) -> bool:
        limits = self._limits
        return len(self._open) >= limits.open_connections or self._by_site[site] >= limits.open_connections_each

    async def _serve(self, accepted: socket.socket, connection: _Connection) -> None:
        accepted.settimeout(0.0)
        timeout = None if self._tls is None else _HANDSHAKE_S
        try:
            connection.transport, _ = await asyncio.get_running_loop().connect_accepted_socket(
                self._protocol, accepted, ssl=self._tls, ssl_handshake_timeout=timeout
            )
        except (OSError, TimeoutError):
            self._refusals[Cause.BAD_HTTP] += 1
            self._discard(connection)
            accepted.close()

    def _discard(self, connection: _Connection) -> None:
        if connection in self._open:
            self._open.remove(connection)
            self._by_site -= Counter((connection.site,))  # a count of zero is not kept
