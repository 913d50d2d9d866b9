# SPDX-License-Identifier: MIT
"""A serial port through pyserial, on any URL that it takes, made so that nothing waits."""

import contextlib
import errno
import fcntl
import grp
import io
import os
import select
import socket
import struct
import termios
from pathlib import Path
from typing import Any, Final

import serial
from serial.tools import list_ports

from segway_ecc.firmware_io.links.settings import SerialSettings

_NO_WRITE_TIMEOUT: Final = ("loop://", "rfc2217://")
"""Of these pyserial refuses one, or with one of 0 never writes."""
_UNSENT: Final = 0x894B
"""SIOCOUTQNSD of linux/sockios.h: what a TCP socket holds and has not sent yet."""
_INT: Final = struct.Struct("i")


def open_serial_port(settings: SerialSettings) -> "PySerialPort":
    """Open a port for this program alone; takes its time.

    Raises:
        OSError: It is not there or cannot be used.
    """
    write_timeout = None if settings.port.lower().startswith(_NO_WRITE_TIMEOUT) else 0
    try:
        port = serial.serial_for_url(
            settings.port, baudrate=settings.baudrate, timeout=0, write_timeout=write_timeout, exclusive=True
        )
        return PySerialPort(port)
    except (termios.error, LookupError, NotImplementedError, ValueError) as error:
        # All of these escape pyserial where a port or its URL is wrong.
        raise OSError(str(error)) from error


def open_remedy(settings: SerialSettings, error: OSError) -> str:
    """What to do about a port that could not be opened."""
    match error.errno:
        case errno.EACCES | errno.EPERM:
            return f"allow yourself to use it: sudo usermod -aG {_group(settings.port)} $USER, then log in again"
        case errno.EAGAIN | errno.EBUSY:
            return f"another program has it open: sudo fuser -v {settings.port}"
        case errno.ENOENT | errno.ENODEV | errno.ENXIO:
            present = ", ".join(sorted(port.device for port in list_ports.comports()))
            there = f"there is {present}" if present else "this machine has no serial port"
            return f"{there}; plug it in, or correct the port in the robot file"
    return "check the port in the robot file, and what is at its other end"


def _group(path: str) -> str:
    """The group that may use a device."""
    try:
        return grp.getgrgid(Path(path).stat().st_gid).gr_name
    except (KeyError, OSError):
        return "dialout"


class PySerialPort:
    """A port of pyserial that is open and never waits; see `Port`."""

    def __init__(self, port: Any) -> None:  # noqa: ANN401 - pyserial has no types
        """Take over an open port: discard what arrived before, and ask for low latency."""
        connection = getattr(port, "_socket", None)  # rfc2217:// has no other way to it
        self._port = port
        self._queued = termios.TIOCOUTQ if connection is None else _UNSENT
        self._fileno = _fileno(port if connection is None else connection)
        self._writable = select.poll()
        if self._fileno is not None:
            self._writable.register(self._fileno, select.POLLOUT)
        with contextlib.suppress(AttributeError, NotImplementedError, OSError, ValueError):
            # FTDI adapters otherwise keep what arrived for up to 16 ms; other ports refuse it or do not know it.
            port.set_low_latency_mode(True)
        if connection is not None:
            # TCP must not wait for more to put into a packet.
            with socket.socket(fileno=os.dup(connection.fileno())) as copy:
                copy.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        port.reset_input_buffer()

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived; of a socket only whether there are any."""
        return int(self._port.in_waiting)

    @property
    def out_waiting(self) -> int:
        """Bytes that are queued and not sent yet."""
        if self._fileno is None:
            return int(getattr(self._port, "out_waiting", 0))
        return int(_INT.unpack(fcntl.ioctl(self._fileno, self._queued, bytes(_INT.size)))[0])

    def read(self, size: int, /) -> bytes:
        """Take up to `size` bytes; some kinds of port give fewer than have arrived, but none only when none has."""
        return bytes(self._port.read(size))

    def write(self, data: bytes, /) -> int:
        """Queue bytes; how many there was room for."""
        # Where there is no room at all pyserial tries again until there is, also with a time-out of 0.
        if self._fileno is not None and not self._writable.poll(0):
            return 0
        return int(self._port.write(data))

    def close(self) -> None:
        """Close the port; pyserial waits 0.3 s after it has closed a socket."""
        with contextlib.suppress(OSError):
            self._port.close()


def _fileno(port: Any) -> int | None:  # noqa: ANN401 - pyserial has no types
    try:
        return int(port.fileno())
    except io.UnsupportedOperation:
        return None
