# SPDX-License-Identifier: MIT
"""Which pages may send us requests, by the headers that browsers add. Pure.

A page of another site can make a browser send us requests, and its name server can make its name point at us (DNS
rebinding). Browsers still send the true Host, Origin and Sec-Fetch-Site, and a page cannot change these.
"""

import ipaddress
import re
from collections.abc import Mapping
from typing import Final, NamedTuple

_HOST: Final = re.compile(r"(\[[0-9A-Fa-f:.]{2,45}\]|[A-Za-z0-9_.-]{1,253})(?::([0-9]{1,5}))?")
_DEFAULT_PORTS: Final = {"http": 80, "https": 443}
_LOOPBACK_NAMES: Final = frozenset({"localhost", "127.0.0.1", "::1"})
_CROSS: Final = frozenset({"cross-site", "same-site"})


class SiteAddress(NamedTuple):
    """Where we are to be found.

    Attributes:
        scheme: `http` or `https`.
        port: Ours.
        names: What we are called besides addresses.
        is_loopback: Whether we are there for this machine only.
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
