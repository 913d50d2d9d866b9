# SPDX-License-Identifier: MIT
"""The virtual bus of one machine, without python-can in between: what `local` means to a robot that runs on it."""

import time
from collections.abc import Iterator

from segway_ecc.firmware_io.links.base_can_link import BaseCanLink, CanBus, NowNs, wall_ns
from segway_ecc.firmware_io.links.can_port import (
    ERROR,
    EXTENDED,
    MAX_FRAMES,
    REMOTE,
    STANDARD_IDENTIFIER,
    Arrival,
    port_error,
    readiness,
    wire_data,
    wire_length,
    wire_word,
)
from segway_ecc.firmware_io.links.link import Frame, LinkCounters
from segway_ecc.firmware_io.links.local_datagrams import BUFFER_BYTES, decode, encode, new_sender
from segway_ecc.firmware_io.links.local_socket import PORT, multicast_group, multicast_socket


class LocalLink(BaseCanLink):
    """A link over the virtual bus; see `local_bus`, which is the same bus for python-can."""

    def __init__(
        self,
        channel: str,
        bitrate: int,
        now_ns: NowNs = time.monotonic_ns,
        wall_ns: NowNs = wall_ns,
        asked: tuple[str, str] | None = None,
    ) -> None:
        """Describe the bus named `channel`; `open` opens it. The other arguments are those of `SocketCanLink`."""
        bus = CanBus.of(("local", channel), asked or ("local", channel), bitrate)
        super().__init__(bus, lambda counters: LocalPort(channel, counters), now_ns, wall_ns)


class LocalPort:
    """A participant of the virtual bus; see `CanPort`."""

    def __init__(self, channel: str, counters: LinkCounters) -> None:
        """Join the bus, or raise LocalBusError."""
        group = multicast_group(channel)
        self._counters = counters
        self._to = (group, PORT)
        self._sender = new_sender()
        self._socket = multicast_socket(group)
        self._is_ready = readiness(self._socket)

    def send(self, frame: Frame) -> None:
        """Send a frame; see `CanPort.send`."""
        try:
            self._socket.sendto(encode(self._sender, wire_word(frame), wire_length(frame), wire_data(frame)), self._to)
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
