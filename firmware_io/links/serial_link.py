# SPDX-License-Identifier: MIT
"""A serial line through pyserial, on any URL it offers, which carries the frames of one drive family."""

import contextlib
import errno
import fcntl
import grp
import io
import operator
import os
import select
import socket
import struct
import termios
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import serial
from serial.tools import list_ports

from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState, Meter, NowNs
from segway_ecc.firmware_io.links.reopening import Recovery
from segway_ecc.firmware_io.links.settings import PortSettings

LOST: Final = "lost"
"""The cause under which a line counts what never arrived, by its sequence numbers."""

_ASK_EVERY_NS: Final = {False: 100_000_000, True: 500_000}
"""Least time between two requests: in standby ten a second; else one in each cycle, at up to 1 kHz."""
_MAX_BYTES: Final = 4096
"""Read in one go, so that a flooded line cannot stall the loop; the rest waits for the next."""
_BITS_PER_BYTE: Final = 10
"""On the wire: start bit, eight bits, stop bit."""
_BACKLOG_S: Final = 0.01
"""Time that a command may wait in the port."""
_LEAST_BACKLOG: Final = 64
"""At least the packets of one cycle, also where the line is too slow for them."""
_MOST_BACKLOG: Final = 1024
_FINISHED_WITHIN_NS: Final = 20_000_000
"""What is left of a packet is sent for this long; later it would bring an old command to a drive."""

_LAST_TIMES: Final = 3
"""How often the last packet is repeated as the line is closed."""
_NO_WRITE_TIMEOUT: Final = ("loop://", "rfc2217://")
"""Of these pyserial refuses one, or with one of 0 never writes."""
_UNSENT: Final = 0x894B
"""SIOCOUTQNSD of linux/sockios.h: what a TCP socket holds and has not sent yet."""
_INT: Final = struct.Struct("i")


class Port(Protocol):
    """What is used of a serial port; `serial.Serial` fulfils it. Nothing here waits."""

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived and wait to be read."""

    def read(self, size: int, /) -> bytes:
        """Take up to `size` bytes."""

    def write(self, data: bytes, /) -> int | None:
        """Queue bytes; how many there was room for, where that is known."""

    def close(self) -> None:
        """Close the port."""


class SerialCodec(Protocol):
    """A serial protocol as a codec: bytes to the frames of a drive family and back. It knows no port."""

    refused: Counter[str]
    """What was received and not taken, by cause."""

    def encode(self, frame: Frame) -> bytes | None:
        """The bytes that carry a frame; None where this protocol has none for it."""

    def request(self) -> bytes:
        """The bytes that ask the device for its telemetry; empty where it is sent unasked."""

    def decode(self, data: bytes, now_ns: int) -> list[Frame]:
        """Take received bytes, in pieces of any size, and return the frames that they complete, stamped `now_ns`.

        Never raises: after garbage, a half frame or an inserted byte it finds the next good frame again.
        """

    def reset(self) -> None:
        """Discard what was received of an unfinished frame."""


OpenPort = Callable[[PortSettings], Port]
"""Opens a port, may take its time, and raises OSError where it cannot."""


class PacketPause(NamedTuple):
    """The silence that the other end needs after each packet, in the time of bytes, and what waits until it is over."""

    bytes: int
    sleep_until_ns: Callable[[int], None]


class PySerialPort:
    """A port of pyserial that is open and never waits; see `Port`."""

    def __init__(self, port: Any) -> None:  # noqa: ANN401 - pyserial has no types
        """Take over an open port: discard what arrived before, and ask for low latency."""
        connection = getattr(port, "_socket", None)  # rfc2217:// has no other way to it
        self._port = port
        self._queued = termios.TIOCOUTQ if connection is None else _UNSENT
        self._fileno: int | None = None
        with contextlib.suppress(io.UnsupportedOperation):
            self._fileno = int((port if connection is None else connection).fileno())
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


def open_serial_port(settings: PortSettings) -> PySerialPort:
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


def open_remedy(settings: PortSettings, error: OSError) -> str:
    """What to do about a port that could not be opened."""
    match error.errno:
        case errno.EACCES | errno.EPERM:
            group = "dialout"
            with contextlib.suppress(KeyError, OSError):
                group = grp.getgrgid(Path(settings.port).stat().st_gid).gr_name
            return f"allow yourself to use it: sudo usermod -aG {group} $USER, then log in again"
        case errno.EAGAIN | errno.EBUSY:
            return f"another program has it open: sudo fuser -v {settings.port}"
        case errno.ENOENT | errno.ENODEV | errno.ENXIO:
            present = ", ".join(sorted(port.device for port in list_ports.comports()))
            there = f"there is {present}" if present else "this machine has no serial port"
            return f"{there}; plug it in, or correct the port in the robot file"
    return "check the port in the robot file, and what is at its other end"


class SerialLink:
    """A link over one serial line; see `Link` and `StandbyLink`.

    The drives' telemetry is requested; the answer to a request is read in the next cycle. A command that the
    port has no room for is dropped: an old command is worse than none. Of a packet that went out in part the rest goes
    first next time, so that what follows is whole; where it is too old for that, the other end refuses the half.

    Where the other end needs a pause after each packet, one that is sent too soon is held back, and is replaced by the
    next. The last one, which switches the motors off, is repeated when the line is closed: nothing follows that would
    make up for one that is lost.

    Frames are stamped when they are read, so they are up to one cycle older than they look.

    Attributes:
        counters: What passed over it; a byte counts as ten bits.
        is_active: Whether it carries the robot's commands, and so asks in every cycle instead of ten times a second.
    """

    def __init__(
        self,
        settings: PortSettings,
        codec: SerialCodec,
        now_ns: NowNs,
        open_port: OpenPort = open_serial_port,
        pause: PacketPause | None = None,
    ) -> None:
        """Describe the line; `open` opens its port."""
        self.counters = LinkCounters()
        self.description = f"serial {settings.port} at {settings.baudrate} bit/s"
        self.is_active = False
        self._settings = settings
        self._codec = codec
        self._now_ns = now_ns
        in_time = round(settings.baudrate / _BITS_PER_BYTE * _BACKLOG_S)
        self._most_waiting = min(max(in_time, _LEAST_BACKLOG), _MOST_BACKLOG)
        self._port: Port | None = None
        self._unwritten = b""
        self._unwritten_ns = 0
        self._asked_ns: int | None = None
        self._pause = pause
        self._last = b""
        self._quiet_ns = 0
        """When the pause after the last packet is over."""
        self._held_back = 0
        self._requests = 0
        self._not_carried = 0
        self._full_reads = 0
        self._meter = Meter(self.counters, now_ns)
        self._recovery: Recovery[Port] = Recovery(
            self.description,
            lambda: open_port(settings),
            operator.methodcaller("close"),
            now_ns,
            remedy="plug it in again",
        )

    @property
    def state(self) -> LinkState:
        """Whether the port is there; a serial line knows nothing of its other end."""
        return LinkState.ACTIVE if self._port is not None else LinkState.GONE

    @property
    def health(self) -> Mapping[str, str]:
        """State, counts, what was refused, and rates since the last call; the load is that of both ways together."""
        return {
            "state": str(self.state),
            **({"lost": self._recovery.reason} if self._recovery.reason else {}),
            **self.counters.as_text(),
            "requests": str(self._requests),
            "not_carried": str(self._not_carried),
            **({} if self._pause is None else {"held_back": str(self._held_back)}),
            "full_reads": str(self._full_reads),
            **{f"refused.{cause}": str(count) for cause, count in sorted(self._codec.refused.items())},
            **self._meter.measure(self._settings.baudrate),
        }

    def open(self) -> None:
        """Open the port; see `Link.open`."""
        self.close()
        try:
            self._use(self._recovery.open())
        except OSError as error:
            raise BusNotFoundError(
                f"cannot open {self.description}: {_text(error)}; {open_remedy(self._settings, error)}"
            ) from error

    def send(self, frame: Frame) -> bool:
        """Queue a frame's packet; see `Link.send`. A frame that the protocol cannot carry is skipped: True."""
        packet = self._codec.encode(frame)
        if packet is None:
            self._not_carried += 1
            return True
        self._last = packet
        if self._pause is not None and self._now_ns() < self._quiet_ns:
            self._held_back += 1
            return True
        port, was_written = self._port, False
        if port is not None:
            try:
                was_written = self._write(port, packet)
                if self.is_active:
                    # In the cycle in which this line becomes the owner, its first answer must not wait for the next.
                    self._ask(port)
            except OSError as error:
                self._lose(port, error)
                was_written = False
        self.counters.sent += was_written
        self.counters.send_dropped += not was_written
        return was_written

    def receive(self) -> list[Frame]:
        """Take what has arrived, and ask for more where it is time; see `Link.receive`."""
        port = self._port
        if port is None:
            port = self._recovery.regain()
            self._use(port)
            self.counters.reopened += 1
        try:
            data = self._read(port)
            self._ask(port)
        except OSError as error:
            self._lose(port, error)
            raise self._recovery.lost() from error
        frames = self._codec.decode(data, self._now_ns())
        self.counters.received += len(frames)
        self.counters.bits += _BITS_PER_BYTE * len(data)
        self.counters.undecodable = self._codec.refused.total() - self._codec.refused[LOST]
        return frames

    def close(self) -> None:
        """Close the port, and whatever is on its way to be opened."""
        self._recovery.end()
        if self._port is not None:
            if self._last and self._pause is not None:
                self._repeat_last(self._port, self._pause)
            self._port.close()
            self._port = None

    def _read(self, port: Port) -> bytes:
        data = bytearray()
        while len(data) < _MAX_BYTES:
            piece = port.read(_MAX_BYTES - len(data))
            if not piece:
                return bytes(data)
            data += piece
        self._full_reads += 1
        return bytes(data)

    def _ask(self, port: Port) -> None:
        now_ns = self._now_ns()
        if self._asked_ns is not None and now_ns - self._asked_ns < _ASK_EVERY_NS[self.is_active]:
            return
        packet = self._codec.request()
        if packet and self._write(port, packet):
            self._requests += 1
        self._asked_ns = now_ns

    def _write(self, port: Port, packet: bytes) -> bool:
        """Queue a packet after the rest of the last one; False where the port has no room for any of it."""
        if getattr(port, "out_waiting", 0) > self._most_waiting:
            return False
        now_ns = self._now_ns()
        if now_ns - self._unwritten_ns > _FINISHED_WITHIN_NS:
            self._unwritten = b""
        queue, due = self._unwritten + packet, len(self._unwritten)
        count = port.write(queue)
        written = len(queue) if count is None else count
        self.counters.bits += _BITS_PER_BYTE * written
        was_begun = written > due
        if was_begun:
            self._unwritten, self._unwritten_ns = queue[written:], now_ns
            self._begin_pause(len(queue))
        else:
            self._unwritten = self._unwritten[written:]
        return was_begun

    def _begin_pause(self, count: int) -> None:
        """Wait, with the next packet, for so many bytes to go out and for the pause after them."""
        if self._pause is not None:
            lasts_s = _BITS_PER_BYTE * (count + self._pause.bytes) / self._settings.baudrate
            self._quiet_ns = self._now_ns() + round(lasts_s * 1e9)

    def _repeat_last(self, port: Port, pause: PacketPause) -> None:
        for _ in range(_LAST_TIMES):
            pause.sleep_until_ns(self._quiet_ns)
            with contextlib.suppress(OSError):
                port.write(self._last)
            self._begin_pause(len(self._last))

    def _use(self, port: Port) -> None:
        self._port = port
        self._unwritten = self._last = b""
        self._asked_ns = None
        self._codec.reset()

    def _lose(self, port: Port, error: OSError) -> None:
        self._recovery.lose(port.close, _text(error))
        self._port = None


def _text(error: OSError) -> str:
    """The text of a port's error, without the number that pyserial puts before it; never empty."""
    return (str(error.args[-1]) if error.args else "") or type(error).__name__
