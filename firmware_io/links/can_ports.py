# SPDX-License-Identifier: MIT
"""What a CAN link is open on: a raw socket of the kernel's own CAN, or python-can, on any interface it offers.

python-can itself is imported where a bus goes through it: it takes a fifth of the time in which a robot starts.
"""
# ruff: noqa: PLC0415 - see above

import contextlib
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

from segway_ecc.firmware_io.links.can_interfaces import check_socketcan, resolve
from segway_ecc.firmware_io.links.can_link import (
    ERROR,
    EXTENDED,
    EXTENDED_IDENTIFIER,
    GONE,
    MAX_DATA,
    MAX_FRAMES,
    REMOTE,
    STANDARD_IDENTIFIER,
    Arrival,
    CanBus,
    CanLink,
    CanPort,
    PortError,
    port_error,
    readiness,
    wall_ns,
    wire_parts,
)
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, NowNs
from segway_ecc.firmware_io.links.local_port import LocalPort

if TYPE_CHECKING:
    import can

_KERNEL_ERROR_FRAMES: Final = frozenset({"socketcan", "socketcand", "gs_usb", "local", "virtual"})
"""Interfaces whose error frames are those of linux/can/error.h; those of others are counted, and not understood."""
_OPTIONS: Final[dict[str, dict[str, Any]]] = {"slcan": {"timeout": 0.0}}
"""Options with which an interface does not wait for a frame that is not there."""
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


def make_can_link(
    interface: str, channel: str, bitrate: int, now_ns: NowNs = time.monotonic_ns, wall_ns: NowNs = wall_ns
) -> CanLink:
    """The link for a bus: over a raw socket where it is the kernel's CAN or the virtual bus, else through python-can.

    Interface and channel are python-can's, or `auto`; see `resolve`. The bit rate, bit/s, is used by backends that set
    it themselves; `now_ns` is the clock of the loop, `wall_ns` that of receive stamps.
    """
    return _link((interface, channel), bitrate, (now_ns, wall_ns), {"socketcan": SocketCanPort, "local": LocalPort})


def make_python_can_link(
    interface: str, channel: str, bitrate: int, now_ns: NowNs = time.monotonic_ns, wall_ns: NowNs = wall_ns
) -> CanLink:
    """The link for a bus through python-can, whatever it is; see `make_can_link`."""
    return _link((interface, channel), bitrate, (now_ns, wall_ns), {})


def _link(
    asked: tuple[str, str],
    bitrate: int,
    clocks: tuple[NowNs, NowNs],
    raw: Mapping[str, Callable[[str, LinkCounters], CanPort]],
) -> CanLink:
    chosen, name = resolve(*asked)
    description = f"{chosen} {name}"
    if "auto" in asked:
        description += f" (chosen by '{' '.join(asked)}')"

    def open_port(counters: LinkCounters) -> CanPort:
        if chosen == "socketcan":
            check_socketcan(name, bitrate)
        if chosen in raw:
            return raw[chosen](name, counters)
        return PythonCanPort(chosen, name, bitrate, counters)

    bus = CanBus(description, bitrate, name if chosen == "socketcan" else None)
    return CanLink(bus, open_port, *clocks)


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
            self._socket.send(_CAN_FRAME.pack(*wire_parts(frame)))
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


class PythonCanPort:
    """An open python-can bus; see `CanPort`."""

    def __init__(self, interface: str, channel: str, bitrate: int, counters: LinkCounters) -> None:
        """Open it, or raise OSError."""
        import can

        self._counters = counters
        self._message = can.Message
        self._understands_errors = interface in _KERNEL_ERROR_FRAMES
        options = _OPTIONS.get(interface, {})
        try:
            self._bus = can.Bus(channel=channel, interface=interface, bitrate=bitrate, **options)
        except (can.CanError, ValueError, ImportError) as error:
            raise OSError(str(error)) from error

    def send(self, frame: Frame) -> None:
        """Queue a frame; see `CanPort.send`."""
        message = self._message(
            arbitration_id=frame.arbitration_id,
            data=None if frame.is_remote else frame.data,
            dlc=wire_parts(frame)[1],
            is_extended_id=frame.is_extended,
            is_remote_frame=frame.is_remote,
            check=False,
        )
        try:
            self._bus.send(message, timeout=0)
        except Exception as error:
            raise _port_error(error) from error

    def drain(self) -> Iterator[Arrival]:
        """What has arrived; see `CanPort.drain`."""
        for _ in range(MAX_FRAMES):
            # Whatever it raises: on a damaged line, that is often what came of decoding it.
            try:
                message = self._bus.recv(0)
                arrival = None if message is None else self._arrival(message)
            except Exception as error:
                raise _port_error(error) from error
            if message is None:
                return
            if arrival is None:
                self._counters.undecodable += 1
            else:
                yield arrival

    def close(self) -> None:
        """Shut the bus down."""
        with contextlib.suppress(Exception):  # one that is gone cannot be shut down
            self._bus.shutdown()

    def _arrival(self, message: "can.Message") -> Arrival | None:
        """A message as it would be on a raw socket; None where it is no classic CAN frame."""
        stamp_ns = int(message.timestamp * 1e9)
        if message.is_error_frame:
            classes = message.arbitration_id & EXTENDED_IDENTIFIER if self._understands_errors else 0
            return classes | ERROR, bytes(message.data), stamp_ns
        identifier, data = message.arbitration_id, bytes(message.data)
        largest = EXTENDED_IDENTIFIER if message.is_extended_id else STANDARD_IDENTIFIER
        is_whole = message.is_remote_frame or len(data) == message.dlc
        if not (is_whole and message.dlc <= MAX_DATA and 0 <= identifier <= largest):
            return None
        flags = (EXTENDED if message.is_extended_id else 0) | (REMOTE if message.is_remote_frame else 0)
        return identifier | flags, data, stamp_ns


def _port_error(error: Exception) -> PortError:
    code = getattr(error, "error_code", None) or getattr(error, "errno", None)
    return PortError(str(error), is_gone=code in GONE)
