# SPDX-License-Identifier: MIT
"""A virtual CAN bus between the processes of one machine, as a python-can interface named `local`.

Every process that opens `can.Bus(interface="local", channel="robot")` sees the frames of all the others, as on vcan,
but no kernel support, privilege or network is needed: frames are datagrams on a multicast group of the loopback device,
which never leave the machine. A receiver that does not keep up loses frames, as a real controller does.
"""

import select
from typing import Any

import can
from can.typechecking import AutoDetectedConfig

from segway_ecc.firmware_io.links.can_link import ERROR, EXTENDED, EXTENDED_IDENTIFIER, FD, REMOTE, SWITCHED
from segway_ecc.firmware_io.links.can_ports import (
    BUFFER_BYTES,
    PORT,
    decode,
    encode,
    multicast_group,
    multicast_socket,
    new_sender,
)


class LocalBus(can.BusABC):
    """One participant on a virtual bus; other channels are other buses."""

    def __init__(
        self,
        channel: Any = "robot",  # noqa: ANN401 - python-can's signature
        can_filters: Any = None,  # noqa: ANN401
        *,
        fd: bool = False,
        **kwargs: Any,  # noqa: ANN401
    ) -> None:
        """Join the bus named `channel`, for classic frames or, with `fd`, for those of CAN FD too."""
        self._group = multicast_group(str(channel))
        self._sender = new_sender()
        try:
            self._socket = multicast_socket(self._group)
        except OSError as error:
            raise can.CanInitializationError(error.strerror or str(error), error.errno) from error
        self.channel_info = f"virtual bus '{channel}' on this machine"
        self.undecodable = 0
        self._can_protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        super().__init__(channel=channel, can_filters=can_filters, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - a datagram is sent at once
        """Send a frame to all other participants.

        Raises:
            can.CanOperationError: The datagram could not be sent.
        """
        if msg.is_fd and self._can_protocol is not can.CanProtocol.CAN_FD:
            raise can.CanOperationError(f"{self.channel_info} was opened for classic CAN frames only")
        flags = (EXTENDED if msg.is_extended_id else 0) | (REMOTE if msg.is_remote_frame else 0)
        flags |= ERROR if msg.is_error_frame else 0
        if msg.is_fd:
            flags |= FD | (SWITCHED if msg.bitrate_switch else 0)
        datagram = encode(self._sender, msg.arbitration_id | flags, msg.dlc, bytes(msg.data))
        try:
            self._socket.sendto(datagram, (self._group, PORT))
        except OSError as error:
            raise can.CanOperationError(f"cannot send on {self.channel_info}: {error.strerror}", error.errno) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        while True:
            try:
                datagram = self._socket.recv(BUFFER_BYTES)
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
        frame = decode(datagram)
        if frame is None:
            self.undecodable += 1
            return None
        sender, stamp_ns, word, length, data = frame
        if sender == self._sender:
            return None
        if word & FD and self._can_protocol is not can.CanProtocol.CAN_FD:
            self.undecodable += 1
            return None
        return can.Message(
            timestamp=stamp_ns * 1e-9,
            arbitration_id=word & EXTENDED_IDENTIFIER,
            is_extended_id=bool(word & EXTENDED),
            is_remote_frame=bool(word & REMOTE),
            is_error_frame=bool(word & ERROR),
            is_fd=bool(word & FD),
            bitrate_switch=bool(word & SWITCHED),
            dlc=length,
            data=b"" if word & REMOTE else data,
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
