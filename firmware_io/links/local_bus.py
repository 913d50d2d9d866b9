"""A virtual CAN bus between the processes of one machine, as a python-can interface named `local`.

Every process that opens `can.Bus(interface="local", channel="robot")` sees the frames of all the others, as on vcan,
but no kernel support, privilege or network is needed: frames are datagrams on a multicast group of the loopback device,
which never leave the machine. A receiver that does not keep up loses frames, as a real controller does.
"""

import errno
import hashlib
import os
import select
import socket
import struct
import time
from typing import Any, Final

import can
from can.typechecking import AutoDetectedConfig

PORT: Final = 48463
_LOOPBACK: Final = "127.0.0.1"
_MAGIC: Final = b"ECC1"
_DATAGRAM: Final = struct.Struct("<4sQQIBx8s")
"""Magic, sender, wall-clock ns, arbitration id with the flags of linux/can.h, data length, data."""
_EXTENDED: Final = 0x80000000
_REMOTE: Final = 0x40000000
_ERROR: Final = 0x20000000
_IDENTIFIER: Final = 0x1FFFFFFF
_RECEIVE_BUFFER_BYTES: Final = 1 << 20
_MAX_DATA: Final = 8


def multicast_group(channel: str) -> str:
    """The loopback multicast address of a channel, from the range for local use (RFC 2365)."""
    digest = hashlib.sha256(channel.encode()).digest()
    return f"239.255.{digest[0]}.{digest[1]}"


class LocalBus(can.BusABC):
    """One participant on a virtual bus; other channels are other buses."""

    def __init__(self, channel: Any = "robot", can_filters: Any = None, **kwargs: Any) -> None:  # noqa: ANN401 - python-can's signature
        """Join the bus named `channel`."""
        self._group = multicast_group(str(channel))
        self._sender = int.from_bytes(os.urandom(8), "little")
        self._socket = _multicast_socket(self._group)
        self.channel_info = f"virtual bus '{channel}' on this machine"
        self.undecodable = 0
        self._can_protocol = can.CanProtocol.CAN_20
        super().__init__(channel=channel, can_filters=can_filters, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - a datagram is sent at once
        """Send a frame to all other participants.

        Raises:
            can.CanOperationError: The datagram could not be sent.
        """
        if msg.is_fd:
            raise can.CanOperationError(f"{self.channel_info} carries classic CAN frames only")
        flags = (_EXTENDED if msg.is_extended_id else 0) | (_REMOTE if msg.is_remote_frame else 0)
        flags |= _ERROR if msg.is_error_frame else 0
        datagram = _DATAGRAM.pack(
            _MAGIC,
            self._sender,
            time.clock_gettime_ns(time.CLOCK_REALTIME),
            msg.arbitration_id | flags,
            msg.dlc,
            bytes(msg.data),
        )
        try:
            self._socket.sendto(datagram, (self._group, PORT))
        except OSError as error:
            raise can.CanOperationError(f"cannot send on {self.channel_info}: {error.strerror}", error.errno) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        while True:
            try:
                datagram = self._socket.recv(256)
            except BlockingIOError:
                if timeout == 0 or not select.select([self._socket], [], [], timeout)[0]:
                    return None, False
                continue
            except OSError as error:
                raise can.CanOperationError(f"{self.channel_info} is closed", error.errno) from error
            message = self._decode(datagram)
            if message is not None or timeout:  # python-can then waits on for what is left of the time
                return message, False

    def _decode(self, datagram: bytes) -> can.Message | None:
        if len(datagram) != _DATAGRAM.size or datagram[:4] != _MAGIC:
            self.undecodable += 1
            return None
        _, sender, stamp_ns, identifier, dlc, data = _DATAGRAM.unpack(datagram)
        if sender == self._sender:
            return None
        if dlc > _MAX_DATA:
            self.undecodable += 1
            return None
        return can.Message(
            timestamp=stamp_ns * 1e-9,
            arbitration_id=identifier & _IDENTIFIER,
            is_extended_id=bool(identifier & _EXTENDED),
            is_remote_frame=bool(identifier & _REMOTE),
            is_error_frame=bool(identifier & _ERROR),
            dlc=dlc,
            data=b"" if identifier & _REMOTE else data[:dlc],
            channel=self.channel_info,
        )

    def fileno(self) -> int:
        """The socket's descriptor, for select."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._socket.close()

    @staticmethod
    def _detect_available_configs() -> list[AutoDetectedConfig]:
        return []


def _multicast_socket(group: str) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        # Bound to the group and not to any address: other channels share the port and must not be heard.
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
        raise can.CanInitializationError(
            f"cannot join the virtual bus: {error.strerror}; {hint}", error.errno
        ) from error
    return sock
