# SPDX-License-Identifier: MIT
"""The sockets that the station listens on, and its address."""

import ipaddress
import socket
import ssl
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.web.origins import SiteAddress
from segway_ecc.node.errors import ConfigurationError

_WAITING: Final = 128
"""Connections that the kernel keeps until they are accepted."""


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
