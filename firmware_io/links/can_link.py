# SPDX-License-Identifier: MIT
"""A CAN bus through python-can, on any interface it offers, and the choice of link for a bus.

python-can itself is imported where a bus goes through it: it takes a fifth of the time in which a robot starts.
"""
# ruff: noqa: PLC0415 - see above

import contextlib
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from segway_ecc.firmware_io.links.base_can_link import BaseCanLink, CanBus, NowNs, wall_ns
from segway_ecc.firmware_io.links.can_interfaces import (
    cannot_open,
    check_socketcan,
    resolve,
    socketcan_interfaces,
)
from segway_ecc.firmware_io.links.can_port import (
    ERROR,
    EXTENDED,
    EXTENDED_IDENTIFIER,
    GONE,
    MAX_DATA,
    MAX_FRAMES,
    REMOTE,
    STANDARD_IDENTIFIER,
    Arrival,
    PortError,
    wire_length,
)
from segway_ecc.firmware_io.links.link import Frame, Link, LinkCounters
from segway_ecc.firmware_io.links.local_link import LocalLink
from segway_ecc.firmware_io.links.socketcan_link import SocketCanLink

if TYPE_CHECKING:
    import can

__all__ = ["CanLink", "PythonCanPort", "make_can_link", "resolve", "socketcan_interfaces", "wall_ns"]

_KERNEL_ERROR_FRAMES: Final = frozenset({"socketcan", "socketcand", "gs_usb", "local", "virtual"})
"""Interfaces whose error frames are those of linux/can/error.h; those of others are counted, and not understood."""
_OPTIONS: Final[dict[str, dict[str, Any]]] = {"slcan": {"timeout": 0.0}}
"""Options with which an interface does not wait for a frame that is not there."""
_NS_PER_S: Final = 1e9


def make_can_link(
    interface: str, channel: str, bitrate: int, now_ns: NowNs = time.monotonic_ns, wall_ns: NowNs = wall_ns
) -> Link:
    """The link for a bus: over a raw socket where it is the kernel's CAN or the virtual bus, else through python-can.

    Args:
        interface: A python-can interface, or `auto`; see `resolve`.
        channel: Its channel, or `auto`.
        bitrate: In bit/s.
        now_ns: The clock of the loop.
        wall_ns: The clock of receive stamps.
    """
    chosen, name = resolve(interface, channel)
    if chosen == "socketcan":
        return SocketCanLink(name, bitrate, now_ns, wall_ns, asked=(interface, channel))
    if chosen == "local":
        return LocalLink(name, bitrate, now_ns, wall_ns, asked=(interface, channel))
    return CanLink(interface, channel, bitrate, now_ns, wall_ns)


class CanLink(BaseCanLink):
    """A link over one python-can bus."""

    def __init__(
        self, interface: str, channel: str, bitrate: int, now_ns: NowNs = time.monotonic_ns, wall_ns: NowNs = wall_ns
    ) -> None:
        """Describe the bus; `open` opens it. `bitrate` in bit/s is used by backends that set it themselves."""
        chosen, name = resolve(interface, channel)
        bus = CanBus.of((chosen, name), (interface, channel), bitrate)

        def open_port(counters: LinkCounters) -> PythonCanPort:
            import can

            if chosen == "socketcan":
                check_socketcan(name, bitrate)
            try:
                return PythonCanPort(chosen, name, bitrate, counters)
            except (can.CanError, ValueError, ImportError) as error:
                raise cannot_open(bus.description, error) from error

        super().__init__(bus, open_port, now_ns, wall_ns)


class PythonCanPort:
    """An open python-can bus; see `CanPort`."""

    def __init__(self, interface: str, channel: str, bitrate: int, counters: LinkCounters) -> None:
        """Open it, or raise what the backend raises."""
        import can

        self._counters = counters
        self._message = can.Message
        self._understands_errors = interface in _KERNEL_ERROR_FRAMES
        self._bus = can.Bus(channel=channel, interface=interface, bitrate=bitrate, **_OPTIONS.get(interface, {}))

    def send(self, frame: Frame) -> None:
        """Queue a frame; see `CanPort.send`."""
        message = self._message(
            arbitration_id=frame.arbitration_id,
            data=None if frame.is_remote else frame.data,
            dlc=wire_length(frame),
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
        stamp_ns = int(message.timestamp * _NS_PER_S)
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
