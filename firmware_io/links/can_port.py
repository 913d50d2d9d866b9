# SPDX-License-Identifier: MIT
"""The interface between a CAN link and what it is open on."""

import errno
import functools
import select
import socket
from collections.abc import Callable, Iterator
from typing import Final, Protocol

from segway_ecc.firmware_io.links.link import Frame

EXTENDED: Final = 0x80000000
"""Flags of linux/can.h in an identifier."""
REMOTE: Final = 0x40000000
ERROR: Final = 0x20000000
EXTENDED_IDENTIFIER: Final = 0x1FFFFFFF
STANDARD_IDENTIFIER: Final = 0x7FF

GONE: Final = frozenset({errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF})
"""Error codes for an interface that is down or away."""
MAX_FRAMES: Final = 512
"""Taken in one drain, so that a flooded bus cannot stall the loop; the rest waits for the next."""
MAX_DATA: Final = 8

Arrival = tuple[int, bytes, int]
"""An identifier with flags, up to 8 bytes, and when it came on the wall clock, ns; 0 where that is not known."""


class PortError(Exception):
    """Sending or receiving failed.

    Attributes:
        is_gone: Whether the interface is down or not there any more.
    """

    def __init__(self, text: str, *, is_gone: bool = False) -> None:
        self.is_gone = is_gone
        super().__init__(text)


class CanPort(Protocol):
    """An open connection to a CAN bus, used until it fails. Nothing here waits, except perhaps `close`."""

    def send(self, frame: Frame) -> None:
        """Queue a frame.

        Raises:
            PortError: It was not queued.
        """

    def drain(self) -> Iterator[Arrival]:
        """What has arrived, at most `MAX_FRAMES`.

        Raises:
            PortError: Receiving failed; what came before it was good.
        """

    def close(self) -> None:
        """Close it; never raises."""


def port_error(error: OSError) -> PortError:
    """The error of a socket as that of a port."""
    return PortError(str(error.strerror), is_gone=error.errno in GONE)


def readiness(sock: socket.socket) -> Callable[[], object]:
    """A function that is true where more has arrived at a socket.

    Receiving where nothing has ends in an exception, which takes longer than to ask: many times, where caches are cold.
    """
    waiting = select.poll()
    waiting.register(sock, select.POLLIN)
    return functools.partial(waiting.poll, 0)


def wire_word(frame: Frame) -> int:
    """The identifier of a frame, with its flags."""
    return frame.arbitration_id | (EXTENDED if frame.is_extended else 0) | (REMOTE if frame.is_remote else 0)


def wire_data(frame: Frame) -> bytes:
    """The data that a frame carries: a remote frame none."""
    return b"" if frame.is_remote else frame.data


def wire_length(frame: Frame) -> int:
    """The length that a frame states: of its data; of a remote frame without any, all 8 bytes."""
    return len(frame.data) or (MAX_DATA if frame.is_remote else 0)
