# SPDX-License-Identifier: MIT
"""Who gets a connection: the limits for one address and for all, and who gives way where a limit is reached."""

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
_REQUEST_NS: Final = 10_000_000_000
"""For a whole request, from when a connection was accepted."""
_RESPONSE_NS: Final = 30_000_000_000
"""For a response to be read, from when it was requested; those that were read wait 15 s for the next request."""
_HANDSHAKE_S: Final = 5.0
_RESET: Final = struct.pack("ii", 1, 0)
"""SO_LINGER of no time: the connection is reset, and nothing of it is kept by the kernel (socket(7))."""


@dataclasses.dataclass(slots=True, eq=False)
class _Connection:
    """One connection, the request of which is due at `due_ns`, or its response; None is never."""

    site: str
    due_ns: int | None
    transport: asyncio.BaseTransport | None = None
    task: asyncio.Task[None] | None = None
    has_request: bool = False
    is_browser: bool = False


class ConnectionLimiter:
    """Accepts the connections that the limits allow, and passes them to a protocol.

    Where a limit is reached the oldest connection that is no browser's gives way, of the address that has the most:
    whoever opens many and lets them wait shuts nobody else out.
    """

    def __init__(
        self, protocol: Callable[[], asyncio.BaseProtocol], shared: SharedServices, tls: ssl.SSLContext | None
    ) -> None:
        """Serve with `protocol`, inside TLS where a context is given."""
        self._protocol = protocol
        _, _, self._refusals, self._limits, self._clock_ns = shared
        self._tls = tls
        self._all = Bucket(shared.limits.all_connections, shared.clock_ns())
        self._each = Buckets(shared.limits.connections)
        self._open: dict[_Connection, None] = {}  # the oldest first
        self._by_transport: dict[asyncio.BaseTransport, _Connection] = {}
        self._by_site: Counter[str] = Counter()
        self._sockets: list[socket.socket] = []

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
        """Note that a connection has made a whole request, the response to which is to be read."""
        connection = self._of(transport)
        if connection is not None:
            connection.has_request, connection.due_ns = True, self._clock_ns() + _RESPONSE_NS

    def on_download(self, transport: asyncio.BaseTransport | None) -> None:
        """Note that a connection is sent something long, to somebody who has a session."""
        connection = self._of(transport)
        if connection is not None:
            connection.due_ns = None

    def on_browser(self, transport: asyncio.BaseTransport | None) -> None:
        """Note that a connection has become a browser's socket, which has limits of its own and never gives way."""
        connection = self._of(transport)
        if connection is not None:
            connection.is_browser, connection.due_ns = True, None

    def sweep(self) -> None:
        """Discard what is closed, and close what is late with its request or does not read its response."""
        now_ns = self._clock_ns()
        for connection in list(self._open):
            if connection.transport is not None and connection.transport.is_closing():
                self._discard(connection)
            elif connection.due_ns is not None and now_ns > connection.due_ns:
                self._cut(connection, Cause.TOO_SLOW if connection.has_request else Cause.SILENT_CONNECTION)

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
            connection = _Connection(site, self._clock_ns() + _REQUEST_NS)
            self._open[connection] = None
            self._by_site[site] += 1
            connection.task = asyncio.get_running_loop().create_task(self._serve(accepted, connection))

    def _refusal(self, site: str) -> Cause | None:
        now_ns = self._clock_ns()
        each = self._each.of(site, now_ns)
        # An address that is over its own limit uses up nothing of what is everybody's.
        if not each.has_token(now_ns) or not self._all.has_token(now_ns):
            return Cause.CONNECTION_RATE
        if not self._has_room(site):
            return Cause.TOO_MANY_CONNECTIONS
        each.take_token(now_ns)
        self._all.take_token(now_ns)
        return None

    def _has_room(self, site: str) -> bool:
        """Whether one more fits, where need be in place of another; it is its own address that makes room first."""
        if self._is_full(site):
            self.sweep()
        if not self._is_full(site):
            return True
        is_site_full = self._by_site[site] >= self._limits.open_connections_each
        giving = Counter(each.site for each in self._open if not each.is_browser)
        largest = site if is_site_full else next((name for name, _ in giving.most_common(1)), "")
        oldest = next((each for each in self._open if each.site == largest and not each.is_browser), None)
        if oldest is not None:
            self._cut(oldest, Cause.TOO_MANY_CONNECTIONS)
        return oldest is not None

    def _is_full(self, site: str) -> bool:
        limits = self._limits
        return len(self._open) >= limits.open_connections or self._by_site[site] >= limits.open_connections_each

    async def _serve(self, accepted: socket.socket, connection: _Connection) -> None:
        accepted.settimeout(0.0)
        timeout = None if self._tls is None else _HANDSHAKE_S
        try:
            transport, _ = await asyncio.get_running_loop().connect_accepted_socket(
                self._protocol, accepted, ssl=self._tls, ssl_handshake_timeout=timeout
            )
        except asyncio.CancelledError:  # it gave way
            accepted.close()
            raise
        except (OSError, TimeoutError):
            self._refusals[Cause.BAD_HTTP] += 1
            self._discard(connection)
            accepted.close()
        else:
            connection.transport = transport
            self._by_transport[transport] = connection

    def _of(self, transport: asyncio.BaseTransport | None) -> _Connection | None:
        return None if transport is None else self._by_transport.get(transport)

    def _cut(self, connection: _Connection, cause: Cause) -> None:
        self._refusals[cause] += 1
        if isinstance(connection.transport, asyncio.WriteTransport):
            connection.transport.abort()  # what is not read yet is not waited for
        elif connection.task is not None:
            connection.task.cancel()
        self._discard(connection)

    def _discard(self, connection: _Connection) -> None:
        if connection in self._open:
            del self._open[connection]
            self._by_site -= Counter((connection.site,))  # a count of zero is not kept
            if connection.transport is not None:
                del self._by_transport[connection.transport]
