# SPDX-License-Identifier: MIT
"""The virtual bus of one machine without python-can: a datagram for each frame, on a multicast group of its loopback.

`local_bus` is the same bus for python-can.
"""

import errno
import hashlib
import os
import socket
import struct
import time
from collections.abc import Iterator
from typing import Final

from segway_ecc.firmware_io.links.can_link import (
    ERROR,
    EXTENDED,
    MAX_DATA,
    MAX_FRAMES,
    REMOTE,
    STANDARD_IDENTIFIER,
    Arrival,
    port_error,
    readiness,
    wire_parts,
)
from segway_ecc.firmware_io.links.link import Frame, LinkCounters

PORT: Final = 48463
_LOOPBACK: Final = "127.0.0.1"
_RECEIVE_BUFFER_BYTES: Final = 1 << 20
BUFFER_BYTES: Final = 256
"""More than a datagram has, so that a longer one is known for what it is."""
_MAGIC: Final = b"ECC1"
_DATAGRAM: Final = struct.Struct("<4sQQIBx8s")
"""Magic, sender, wall-clock ns, arbitration id with the flags of linux/can.h, data length, data."""

Datagram = tuple[int, int, int, int, bytes]
"""A frame on the virtual bus: who of its participants sent it; when, on the wall clock, ns; its identifier with the
flags of linux/can.h; the length that it states, 0 to 8; and as many bytes."""


def new_sender() -> int:
    """A number that no other participant has."""
    return int.from_bytes(os.urandom(8), "little")


def encode(sender: int, word: int, length: int, data: bytes) -> bytes:
    """A datagram, stamped with the wall clock's time of now."""
    return _DATAGRAM.pack(_MAGIC, sender, time.clock_gettime_ns(time.CLOCK_REALTIME), word, length, data)


def decode(datagram: bytes) -> Datagram | None:
    """The frame in a datagram; None where there is none."""
    if len(datagram) != _DATAGRAM.size:
        return None
    magic, sender, stamp_ns, word, length, data = _DATAGRAM.unpack(datagram)
    if magic != _MAGIC or length > MAX_DATA:
        return None
    return sender, stamp_ns, word, length, data[:length]


def multicast_group(channel: str) -> str:
    """The loopback multicast address of a channel, from the range for local use (RFC 2365)."""
    digest = hashlib.sha256(channel.encode()).digest()
    return f"239.255.{digest[0]}.{digest[1]}"


def multicast_socket(group: str) -> socket.socket:
    """A socket that has joined the bus of a group and sends to it.

    Raises:
        OSError: The loopback device does not let it.
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
        raise OSError(error.errno, f"cannot join the virtual bus: {error.strerror}; {hint}") from error
    return sock


class LocalPort:
    """A participant of the virtual bus; see `CanPort`."""

    def __init__(self, channel: str, counters: LinkCounters) -> None:
        """Join the bus, or raise OSError."""
        group = multicast_group(channel)
        self._counters = counters
        self._to = (group, PORT)
        self._sender = new_sender()
        self._socket = multicast_socket(group)
        self._is_ready = readiness(self._socket)

    def send(self, frame: Frame) -> None:
        """Send a frame; see `CanPort.send`."""
        try:
            self._socket.sendto(encode(self._sender, *wire_parts(frame)), self._to)
        except OSError as error:
            raise port_error(error) from error

    def drain(self) -> Iterator[Arrival]:
        """What has arrived; see `CanPort.drain`."""
        receive, own = self._socket.recv, self._sender
        for _ in range(MAX_FRAMES):
            try:
                frame = decode(receive(BUFFER_BYTES))
            except BlockingIOError:
                return
            except OSError as error:
                raise port_error(error) from error
            sender, stamp_ns, word, _, data = frame or (own, 0, 0, 0, b"")
            # A standard frame's identifier has 11 bits at most; an error frame's are classes of errors.
            if frame is None or not (word & (EXTENDED | ERROR) or word & ~REMOTE <= STANDARD_IDENTIFIER):
                self._counters.undecodable += 1
            elif sender != own:
                yield word, data, stamp_ns
            if not self._is_ready():
                return

    def close(self) -> None:
        """Leave the bus."""
        self._socket.close()
