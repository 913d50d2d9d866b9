# SPDX-License-Identifier: MIT
"""What a CAN link is open on: the kernel's own CAN, the virtual bus of this machine, or any interface of python-can.

The virtual bus is a datagram for each frame, on a multicast group of the loopback device; `local_bus` is the same bus
for python-can. That is imported where a bus goes through it: it takes a fifth of the time in which a robot starts.
"""
# ruff: noqa: PLC0415 - see above

import contextlib
import errno
import hashlib
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

from segway_ecc.firmware_io.clock import wall_ns
from segway_ecc.firmware_io.links.can_interfaces import check_socketcan, resolve
from segway_ecc.firmware_io.links.can_link import (
    ERROR,
    EXTENDED,
    EXTENDED_IDENTIFIER,
    FD,
    GONE,
    MAX_DATA,
    MAX_FRAMES,
    REMOTE,
    STANDARD_IDENTIFIER,
    SWITCHED,
    WORD,
    Arrival,
    CanBus,
    CanLink,
    CanPort,
    PortError,
    port_error,
    readiness,
    wire_parts,
)
from segway_ecc.firmware_io.links.link import FD_LENGTHS, Frame, LinkCounters, NowNs

if TYPE_CHECKING:
    import can

_KERNEL_ERROR_FRAMES: Final = frozenset({"socketcan", "socketcand", "gs_usb", "local", "virtual"})
"""Interfaces whose error frames are those of linux/can/error.h; those of others are counted, and not understood."""
_OPTIONS: Final[dict[str, dict[str, Any]]] = {"slcan": {"timeout": 0.0}}
"""Options with which an interface does not wait for a frame that is not there."""
_CAN_FRAME: Final = struct.Struct("=IB3x8s")
"""can_frame of linux/can.h: identifier with flags, length, data."""
_CANFD_FRAME: Final = struct.Struct("=IBB2x64s")
"""canfd_frame of linux/can.h: identifier with flags, length, flags of CAN FD, data."""
_CANFD_BRS: Final = 1
"""Of those flags: the data go at a bit rate of their own."""
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
PORT: Final = 48463
_LOOPBACK: Final = "127.0.0.1"
BUFFER_BYTES: Final = 256
"""More than a datagram has, so that a longer one is known for what it is."""
_MAGIC: Final = b"ECC1"
_DATAGRAM: Final = struct.Struct("<4sQQIBx8s")
"""Magic, sender, wall-clock ns, arbitration id with the flags of linux/can.h, data length, data."""
_FD_MAGIC: Final = b"ECF1"
_FD_DATAGRAM: Final = struct.Struct("<4sQQIBB64s")
"""The same for CAN FD, with its flags after the length."""

Datagram = tuple[int, int, int, int, bytes]
"""A frame on the virtual bus: who of its participants sent it; when, on the wall clock, ns; its identifier with the
flags of linux/can.h, and ours for CAN FD; the length that it states; and as many bytes."""
OpenRaw = Callable[[str, LinkCounters, CanBus], CanPort]


def make_can_link(  # noqa: PLR0913 - what a bus is, and two clocks
    interface: str,
    channel: str,
    bitrate: int,
    now_ns: NowNs = time.monotonic_ns,
    wall_ns: NowNs = wall_ns,
    *,
    fd_bitrate: int | None = None,
) -> CanLink:
    """The link for a bus: over a raw socket where it is the kernel's CAN or the virtual bus, else through python-can.

    Interface and channel are python-can's, or `auto`; see `resolve`. The bit rate, bit/s, is used by backends that set
    it themselves; `now_ns` is the clock of the loop, `wall_ns` that of receive stamps. With `fd_bitrate`, bit/s, the
    bus carries CAN FD too, whose data go at that rate.
    """
    raw: Mapping[str, OpenRaw] = {"socketcan": SocketCanPort, "local": LocalPort}
    return _link((interface, channel), (bitrate, fd_bitrate), (now_ns, wall_ns), raw)


def make_python_can_link(  # noqa: PLR0913 - as above
    interface: str,
    channel: str,
    bitrate: int,
    now_ns: NowNs = time.monotonic_ns,
    wall_ns: NowNs = wall_ns,
    *,
    fd_bitrate: int | None = None,
) -> CanLink:
    """The link for a bus through python-can, whatever it is; see `make_can_link`."""
    return _link((interface, channel), (bitrate, fd_bitrate), (now_ns, wall_ns), {})


def _link(
    asked: tuple[str, str], rates: tuple[int, int | None], clocks: tuple[NowNs, NowNs], raw: Mapping[str, OpenRaw]
) -> CanLink:
    chosen, name = resolve(*asked)
    description = f"{chosen} {name}"
    if "auto" in asked:
        description += f" (chosen by '{' '.join(asked)}')"
    bitrate, fd_bitrate = rates
    bus = CanBus(description, bitrate, name if chosen == "socketcan" else None, fd_bitrate)

    def open_port(counters: LinkCounters) -> CanPort:
        if chosen == "socketcan":
            check_socketcan(name, bitrate, fd_bitrate)
        if chosen in raw:
            return raw[chosen](name, counters, bus)
        return PythonCanPort(chosen, name, counters, bus)

    return CanLink(bus, open_port, *clocks)


def _switched(bus: CanBus) -> int:
    """The flag of frames of CAN FD on a bus: whether their data go at a rate of their own."""
    return SWITCHED if bus.fd_bitrate not in (None, bus.bitrate) else 0


class SocketCanPort:
    """A raw CAN socket; see `CanPort`."""

    def __init__(self, channel: str, counters: LinkCounters, bus: CanBus) -> None:
        """Open it on the network interface `channel`, or raise OSError."""
        self._counters = counters
        self._dropped = 0
        self._fd_flags = _CANFD_BRS if _switched(bus) else 0
        self._largest = _CAN_FRAME.size if bus.fd_bitrate is None else _CANFD_FRAME.size
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        try:
            self._socket.setblocking(False)  # noqa: FBT003 - the standard library's signature
            try:
                # Past the limit that the machine sets for everyone, where we may.
                self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER_BYTES)
            except PermissionError:
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            self._socket.setsockopt(socket.SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, _ALL_ERRORS)
            self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_RECV_OWN_MSGS, 0)
            if bus.fd_bitrate is not None:
                self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
            self._socket.bind((channel,))
        except OSError:
            self._socket.close()
            raise
        self._is_ready = readiness(self._socket)

    def send(self, frame: Frame) -> None:
        """Queue a frame; see `CanPort.send`."""
        word, length, data = wire_parts(frame)
        try:
            if word < FD:
                self._socket.send(_CAN_FRAME.pack(word, length, data))
            else:
                self._socket.send(_CANFD_FRAME.pack(word & WORD, length, self._fd_flags, data))
        except OSError as error:
            raise port_error(error) from error

    def drain(self) -> Iterator[Arrival]:
        """What has arrived; see `CanPort.drain`."""
        receive = self._socket.recvmsg
        for _ in range(MAX_FRAMES):
            try:
                frame, ancillary, _, _ = receive(self._largest, _ANCILLARY_BYTES)
            except BlockingIOError:
                return
            except OSError as error:
                raise port_error(error) from error
            if len(frame) == _CAN_FRAME.size:
                word, length, data = _CAN_FRAME.unpack(frame)
                yield word, data[:length], self._stamp_ns(ancillary)
            elif len(frame) == _CANFD_FRAME.size:
                word, length, _, data = _CANFD_FRAME.unpack(frame)
                yield word | FD, data[:length], self._stamp_ns(ancillary)
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


class LocalPort:
    """A participant of the virtual bus; see `CanPort`."""

    def __init__(self, channel: str, counters: LinkCounters, bus: CanBus) -> None:
        """Join the bus, or raise OSError."""
        group = multicast_group(channel)
        self._counters = counters
        self._switched = _switched(bus)
        self._most = WORD if bus.fd_bitrate is None else WORD | FD | SWITCHED
        self._to = (group, PORT)
        self._sender = new_sender()
        self._socket = multicast_socket(group)
        self._is_ready = readiness(self._socket)

    def send(self, frame: Frame) -> None:
        """Send a frame; see `CanPort.send`."""
        word, length, data = wire_parts(frame)
        if word >= FD:
            word |= self._switched
        if word > self._most:
            raise PortError("it was opened for classic CAN frames")
        try:
            self._socket.sendto(encode(self._sender, word, length, data), self._to)
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
            # A standard frame's identifier has 11 bits at most; an error frame's are classes of errors. Of CAN FD
            # nothing is received where it was not asked for, as a classic controller would have it.
            is_whole = word & (EXTENDED | ERROR) or word & WORD & ~REMOTE <= STANDARD_IDENTIFIER
            if frame is None or word > self._most or not is_whole:
                self._counters.undecodable += 1
            elif sender != own:
                yield word, data, stamp_ns
            if not self._is_ready():
                return

    def close(self) -> None:
        """Leave the bus."""
        self._socket.close()


def new_sender() -> int:
    """A number that no other participant has."""
    return int.from_bytes(os.urandom(8), "little")


def encode(sender: int, word: int, length: int, data: bytes) -> bytes:
    """A datagram, stamped with the wall clock's time of now."""
    now_ns = time.clock_gettime_ns(time.CLOCK_REALTIME)
    if word < FD:
        return _DATAGRAM.pack(_MAGIC, sender, now_ns, word, length, data)
    return _FD_DATAGRAM.pack(_FD_MAGIC, sender, now_ns, word & WORD, length, word >> 32, data)


def decode(datagram: bytes) -> Datagram | None:
    """The frame in a datagram; None where there is none."""
    if len(datagram) == _FD_DATAGRAM.size:
        magic, sender, stamp_ns, word, length, flags, data = _FD_DATAGRAM.unpack(datagram)
        if magic != _FD_MAGIC or length not in FD_LENGTHS:
            return None
        return sender, stamp_ns, word & ~(REMOTE | ERROR) | FD | (SWITCHED & flags << 32), length, data[:length]
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


class PythonCanPort:
    """An open python-can bus; see `CanPort`."""

    def __init__(self, interface: str, channel: str, counters: LinkCounters, bus: CanBus) -> None:
        """Open it, or raise OSError."""
        import can

        self._counters = counters
        self._message = can.Message
        self._understands_errors = interface in _KERNEL_ERROR_FRAMES
        # Of SocketCAN, python-can marks what any program of this machine sent; our own does not come back there.
        self._marks_own = interface != "socketcan"
        self._is_switched = bool(_switched(bus))
        self._takes_fd = bus.fd_bitrate is not None
        options = _OPTIONS.get(interface, {})
        if bus.fd_bitrate is not None:
            options = {**options, "fd": True, "data_bitrate": bus.fd_bitrate}
        try:
            self._bus = can.Bus(channel=channel, interface=interface, bitrate=bus.bitrate, **options)
        except Exception as error:  # a driver may raise anything, NameErrors included
            raise OSError(str(error)) from error

    def send(self, frame: Frame) -> None:
        """Queue a frame; see `CanPort.send`."""
        message = self._message(
            arbitration_id=frame.arbitration_id,
            data=None if frame.is_remote else frame.data,
            dlc=wire_parts(frame)[1],
            is_extended_id=frame.is_extended,
            is_remote_frame=frame.is_remote,
            is_fd=frame.is_fd,
            bitrate_switch=frame.is_fd and self._is_switched,
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
            if self._marks_own and not message.is_rx:
                self._counters.echoes += 1
            elif arrival is None:
                self._counters.undecodable += 1
            else:
                yield arrival

    def close(self) -> None:
        """Shut the bus down."""
        with contextlib.suppress(Exception):  # one that is gone cannot be shut down
            self._bus.shutdown()

    def _arrival(self, message: "can.Message") -> Arrival | None:
        """A message as it would be on a raw socket; None where it is no CAN frame, or of CAN FD and not asked for."""
        stamp_ns = int(message.timestamp * 1e9)
        if message.is_error_frame:
            classes = message.arbitration_id & EXTENDED_IDENTIFIER if self._understands_errors else 0
            return classes | ERROR, bytes(message.data), stamp_ns
        identifier, data = message.arbitration_id, bytes(message.data)
        largest = EXTENDED_IDENTIFIER if message.is_extended_id else STANDARD_IDENTIFIER
        is_whole = message.is_remote_frame or len(data) == message.dlc
        lengths = FD_LENGTHS if message.is_fd else FD_LENGTHS[: MAX_DATA + 1]
        if not (is_whole and message.dlc in lengths and 0 <= identifier <= largest):
            return None
        if message.is_fd and not self._takes_fd:
            return None
        flags = (EXTENDED if message.is_extended_id else 0) | (REMOTE if message.is_remote_frame else 0)
        flags |= FD if message.is_fd else 0
        return identifier | flags, data, stamp_ns


def _port_error(error: Exception) -> PortError:
    code = getattr(error, "error_code", None) or getattr(error, "errno", None)
    return PortError(str(error), is_gone=code in GONE)
