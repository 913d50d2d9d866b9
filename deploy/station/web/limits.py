# SPDX-License-Identifier: MIT
"""Rate limits: token buckets on a clock that is given. Pure."""

import ipaddress
from collections import OrderedDict
from collections.abc import Hashable
from typing import Final, NamedTuple

_NS: Final = 1e-9
_MOST_KEYS: Final = 4096
_IPV6_SITE_BITS: Final = 64


class Rate(NamedTuple):
    """A rate: `per_s` in the long run, 1/s, which may be exceeded for a moment by `burst` at once."""

    per_s: float
    burst: int


class Limits(NamedTuple):
    """The limits of the station.

    Attributes:
        connections: New connections of one address.
        all_connections: New connections of everybody.
        requests: HTTP requests of one address.
        logins: Attempts that failed, of one address.
        all_logins: Attempts that failed, of everybody.
        messages: Messages on one socket, of any kind.
        commands: Commands of one session, stops apart.
        stops: Stops of one session; a bucket of their own, so that nothing else uses it up.
        drives: Set-points of one session.
        mistakes: Messages that are refused; one socket that sends more is closed.
        open_connections: At the same time; of more the oldest that is no browser's gives way.
        open_connections_each: At the same time, of one address; as above.
        sockets: Browsers at the same time.
        sockets_each: Browsers at the same time, of one address.
        sockets_kept: Of these, those that no viewer takes: an operator finds room.
        ping_s: How often a browser is pinged, s; it has half of that to answer.
    """

    connections: Rate = Rate(50.0, 300)
    all_connections: Rate = Rate(200.0, 1000)
    requests: Rate = Rate(100.0, 500)
    logins: Rate = Rate(0.2, 5)
    all_logins: Rate = Rate(5.0, 50)
    messages: Rate = Rate(100.0, 400)
    commands: Rate = Rate(10.0, 30)
    stops: Rate = Rate(50.0, 200)
    drives: Rate = Rate(30.0, 30)
    mistakes: Rate = Rate(0.2, 20)
    open_connections: int = 512
    open_connections_each: int = 256
    sockets: int = 200
    sockets_each: int = 128
    sockets_kept: int = 20
    ping_s: float = 10.0


class Bucket:
    """Holds up to `burst` tokens, and gains `per_s` of them each second."""

    __slots__ = ("_at_ns", "_rate", "_tokens")

    def __init__(self, rate: Rate, now_ns: int) -> None:
        self._rate = rate
        self._tokens = float(rate.burst)
        self._at_ns = now_ns

    def has_token(self, now_ns: int) -> bool:
        """Whether there is a token."""
        gained = max(now_ns - self._at_ns, 0) * _NS * self._rate.per_s
        self._tokens = min(self._tokens + gained, float(self._rate.burst))
        self._at_ns = max(now_ns, self._at_ns)
        return self._tokens >= 1.0

    def take_token(self, now_ns: int) -> bool:
        """Take a token; False where there is none."""
        if not self.has_token(now_ns):
            return False
        self._tokens -= 1.0
        return True


class Buckets:
    """A bucket for each key, at first full; of more than `most` keys the one that was idle for longest is discarded."""

    def __init__(self, rate: Rate, most: int = _MOST_KEYS) -> None:
        self._rate = rate
        self._most = most
        self._buckets: OrderedDict[Hashable, Bucket] = OrderedDict()

    def __len__(self) -> int:
        return len(self._buckets)

    def of(self, key: Hashable, now_ns: int) -> Bucket:
        """The bucket of a key."""
        bucket = self._buckets.pop(key, None) or Bucket(self._rate, now_ns)
        self._buckets[key] = bucket
        if len(self._buckets) > self._most:
            self._buckets.popitem(last=False)
        return bucket


def site_of(address: str) -> str:
    """What counts as one address: an IPv6 network of 64 bits is given to one customer as a whole."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(parsed, ipaddress.IPv4Address):
        return str(parsed)
    if parsed.ipv4_mapped is not None:
        return str(parsed.ipv4_mapped)
    return str(ipaddress.ip_network((parsed, _IPV6_SITE_BITS), strict=False))
