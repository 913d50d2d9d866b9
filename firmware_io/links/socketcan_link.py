# SPDX-License-Identifier: MIT
"""A CAN bus through the kernel's own CAN, without python-can in between: the link for short cycles."""

import socket
import struct
import time
from collections.abc import Iterator
from typing import Final

from segway_ecc.firmware_io.links.base_can_link import BaseCanLink, CanBus, NowNs, wall_ns
from segway_ecc.firmware_io.links.can_interfaces import check_socketcan
from segway_ecc.firmware_io.links.can_port import (
    MAX_FRAMES,
    Arrival,
    port_error,
    readiness,
    wire_data,
    wire_length,
    wire_word,
)
from segway_ecc.firmware_io.links.link import Frame, LinkCounters

_CAN_FRAME: Final = struct.Struct("=IB3x8s")
"""can_frame of linux/can.h: identifier with flags, length, data."""
_TIMESPEC: Final = struct.Struct("@ll")
_U32: Final = struct.Struct("=I")
_SO_RCVBUFFORCE: Final = 33
_SO_TIMESTAMPNS: Final = 35
_SO_RXQ_OVFL: Final = 40
"""Options of asm-generic/socket.h that Python does not name."""
_CAN_RAW_ERR_FILTER: Final = 2
"""Of linux/can/raw.h, likewise."""
_ALL_ERRORS: Final = 0x1FFFFFFF
_RECEIVE_BUFFER_BYTES: Final = 1 << 20
_ANCILLARY_BYTES: Final = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_U32.size)
_NS_PER_S: Final = 1_000_000_000
_COUNT_BITS: Final = 0xFFFFFFFF


class SocketCanLink(BaseCanLink):
    """A link over a raw socket of one CAN network interface; stamps are the kernel's."""

    def __init__(
        self,
        channel: str,
        bitrate: int,
        now_ns: NowNs = time.monotonic_ns,
        wall_ns: NowNs = wall_ns,
        asked: tuple[str, str] | None = None,
    ) -> None:
        """Describe the bus; `open` opens it.

        Args:
            channel: The name of the network interface.
            bitrate: What it should be set to, bit/s; it is set by who sets the interface up.
            now_ns: The clock of the loop.
            wall_ns: The clock of the kernel's stamps.
            asked: The interface and channel of the configuration, where they left open which bus this is.
        """

        def open_port(counters: LinkCounters) -> SocketCanPort:
            check_socketcan(channel, bitrate)
            return SocketCanPort(channel, counters)

        bus = CanBus.of(("socketcan", channel), asked or ("socketcan", channel), bitrate)
        super().__init__(bus, open_port, now_ns, wall_ns)


class SocketCanPort:
    """A raw CAN socket; see `CanPort`."""

    def __init__(self, channel: str, counters: LinkCounters) -> None:
        """Open it on the network interface `channel`, or raise OSError."""
        self._counters = counters
        self._dropped = 0
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        try:
            _configure(self._socket)
            self._socket.bind((channel,))
        except OSError:
            self._socket.close()
            raise
        self._is_ready = readiness(self._socket)

    def send(self, frame: Frame) -> None:
        """Queue a frame; see `CanPort.send`."""
        try:
            self._socket.send(_CAN_FRAME.pack(wire_word(frame), wire_length(frame), wire_data(frame)))
        except OSError as error:
            raise port_error(error) from error

    def drain(self) -> Iterator[Arrival]:
        """What has arrived; see `CanPort.drain`."""
        receive = self._socket.recvmsg
        for _ in range(MAX_FRAMES):
            try:
                frame, ancillary, _, _ = receive(_CAN_FRAME.size, _ANCILLARY_BYTES)
            except BlockingIOError:
                return
            except OSError as error:
                raise port_error(error) from error
            if len(frame) == _CAN_FRAME.size:
                word, length, data = _CAN_FRAME.unpack(frame)
                yield word, data[:length], self._stamp_ns(ancillary)
            else:
                self._counters.undecodable += 1
            if not self._is_ready():
                return

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _stamp_ns(self, ancillary: list[tuple[int, int, bytes]]) -> int:
        """The kernel's stamp, ns; of what else comes with a frame, count what the receive queue lost before it."""
        stamp_ns = 0
        for _, kind, value in ancillary:
            if kind == _SO_TIMESTAMPNS:
                seconds, nanoseconds = _TIMESPEC.unpack(value)
                stamp_ns = seconds * _NS_PER_S + nanoseconds
            elif kind == _SO_RXQ_OVFL:
                (dropped,) = _U32.unpack(value)
                self._counters.overflows += (dropped - self._dropped) & _COUNT_BITS
                self._dropped = dropped
        return stamp_ns


def _configure(sock: socket.socket) -> None:
    sock.setblocking(False)  # noqa: FBT003 - the standard library's signature
    try:
        # Past the limit that the machine sets for everyone, where we may.
        sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER_BYTES)
    except PermissionError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
    sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
    sock.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
    sock.setsockopt(socket.SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, _ALL_ERRORS)
    sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_RECV_OWN_MSGS, 0)
