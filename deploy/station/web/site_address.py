# SPDX-License-Identifier: MIT
"""The sockets that the station listens on, its address, and which pages may send it requests.

A page of another site can make a browser send us requests, and its name server can make its name point at us (DNS
rebinding). Browsers still send the true Host, Origin and Sec-Fetch-Site, and a page cannot change these.
"""

import ipaddress
import re
import socket
import ssl
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from segway_ecc.node.errors import ConfigurationError

_HOST: Final = re.compile(r"(\[[0-9A-Fa-f:.]{2,45}\]|[A-Za-z0-9_.-]{1,253})(?::([0-9]{1,5}))?")
_DEFAULT_PORTS: Final = {"http": 80, "https": 443}
_LOOPBACK_NAMES: Final = frozenset({"localhost", "127.0.0.1", "::1"})
_CROSS: Final = frozenset({"cross-site", "same-site"})
_WAITING: Final = 128
"""Connections that the kernel keeps until they are accepted."""


class SiteAddress(NamedTuple):
    """Where we are to be found, by `http` or `https`; the names are what we are called besides addresses.

    On loopback we are there for this machine only.
    """

    scheme: str
    port: int
    names: frozenset[str] = frozenset()
    is_loopback: bool = True

    def is_ours(self, host: str | None) -> bool:
        """Whether a Host header is one of our own: an address, or one of our names, with our port."""
        match = _HOST.fullmatch(host or "")
        if match is None:
            return False
        if self.port != (int(match[2]) if match[2] else _DEFAULT_PORTS[self.scheme]):
            return False
        name = match[1].strip("[]").lower().rstrip(".")
        if name in _LOOPBACK_NAMES or name in self.names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        # Nobody's name server is asked for an address, so an address cannot be made to point elsewhere.
        return address.is_loopback if self.is_loopback else True

    def may_request(self, method: str, headers: Mapping[str, str], *, opens_socket: bool = False) -> bool:
        """Whether a request comes from our own page, or from no page at all.

        What changes something, or opens a socket, names its origin; where none is named, no browser sent it, which is
        believed only without a cookie and without anything that browsers add.
        """
        origin = headers.get("Origin")
        if origin is not None:
            return origin == f"{self.scheme}://{headers.get('Host', '')}"
        site = headers.get("Sec-Fetch-Site")
        if method == "GET" and not opens_socket:
            # Somebody may follow a link to our page, which may stand anywhere; not inside a frame of theirs.
            is_visit = headers.get("Sec-Fetch-Mode") == "navigate" and headers.get("Sec-Fetch-Dest") == "document"
            return site not in _CROSS or is_visit
        return site is None and "Cookie" not in headers


def bind(address: str, port: int) -> list[socket.socket]:
    """Listen on every address that a name has, at the same port; 0 is any that is free.

    Raises:
        ConfigurationError: It cannot be listened on.
    """
    sockets: list[socket.socket] = []
    try:
        found = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, host in dict.fromkeys((family, str(place[0])) for family, _, _, _, place in found):
            bound = socket.socket(family, socket.SOCK_STREAM)
            sockets.append(bound)
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                bound.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            bound.bind((host, port or sockets[0].getsockname()[1]))
            bound.listen(_WAITING)
    except OSError as error:
        for bound in sockets:
            bound.close()
        why = error.strerror or str(error)
        raise ConfigurationError(f"--address {address} --port {port} cannot be listened on: {why}") from None
    return sockets


def site_address_of(sockets: Sequence[socket.socket], scheme: str, names: Sequence[str]) -> SiteAddress:
    """Our address: loopback if nothing else can reach any of the sockets, else with this machine's names."""
    port = int(sockets[0].getsockname()[1])
    is_loopback = all(ipaddress.ip_address(bound.getsockname()[0]).is_loopback for bound in sockets)
    known = {name.lower().rstrip(".") for name in names}
    if not is_loopback:
        host = socket.gethostname().lower()
        short = host.partition(".")[0]
        known |= {host, short, f"{short}.local"}
    return SiteAddress(scheme, port, frozenset(known), is_loopback)


def url(address: str, place: SiteAddress) -> str:
    """What to open in a browser."""
    host = f"[{address}]" if ":" in address else address
    if host in {"0.0.0.0", "[::]"}:  # noqa: S104 - compared, not bound
        host = socket.gethostname()
    return f"{place.scheme}://{host}:{place.port}/"


def tls_context(certificate: Path, key: Path | None) -> ssl.SSLContext:
    """TLS 1.2 or later, with a certificate and its key, which may stand in the same file.

    Raises:
        ConfigurationError: They cannot be read, do not belong together, or the key needs a passphrase.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # Without this a key with a passphrase would ask for it at the terminal.
        context.load_cert_chain(certificate, key, password=lambda: b"")
    except OSError as error:  # ssl.SSLError is one
        why = error.strerror or str(error)
        files = f"--certificate {certificate}" + (f" --key {key}" if key else "")
        raise ConfigurationError(f"{files} cannot be used: {why}") from None
    return context
