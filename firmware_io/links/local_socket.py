# SPDX-License-Identifier: MIT
"""The sockets of the virtual bus of one machine: a multicast group of its loopback device."""

import errno
import hashlib
import socket
from typing import Final

PORT: Final = 48463
_LOOPBACK: Final = "127.0.0.1"
_RECEIVE_BUFFER_BYTES: Final = 1 << 20


class LocalBusError(OSError):
    """The virtual bus cannot be joined."""


def multicast_group(channel: str) -> str:
    """The loopback multicast address of a channel, from the range for local use (RFC 2365)."""
    digest = hashlib.sha256(channel.encode()).digest()
    return f"239.255.{digest[0]}.{digest[1]}"


def multicast_socket(group: str) -> socket.socket:
    """A socket that has joined the bus of a group and sends to it.

    Raises:
        LocalBusError: The loopback device does not let it.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        # Bound to the group and not to any address: other channels share the port and must not be received.
        sock.bind((group, PORT))
        loopback = socket.inet_aton(_LOOPBACK)
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + loopback)
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
        # Time to live 0: a frame cannot leave this machine whatever its routes are.
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        sock.setblocking(False)  # noqa: FBT003 - the standard library's signature
    except OSError as error:
        sock.close()
        hint = "bring the loopback device up: ip link set lo up" if error.errno == errno.ENODEV else "is lo up?"
        raise LocalBusError(error.errno, f"cannot join the virtual bus: {error.strerror}; {hint}") from error
    return sock
