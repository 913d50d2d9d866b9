# SPDX-License-Identifier: MIT
"""What every CAN link does, whatever port it is open on: counting, stamps, the state of the bus, coming back."""

import errno
import functools
import select
import socket
from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple, Protocol

from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.firmware_io.links.can_errors import BusErrors
from segway_ecc.firmware_io.links.can_interfaces import InterfaceState, InterfaceWatch
from segway_ecc.firmware_io.links.link import (
    FD_LENGTHS,
    Frame,
    LinkCounters,
    LinkState,
    Meter,
    NowNs,
    worst_case_bits,
    worst_case_fd_bits,
)
from segway_ecc.firmware_io.links.reopening import Recovery

EXTENDED: Final = 0x80000000
"""Flags of linux/can.h in an identifier."""
REMOTE: Final = 0x40000000
ERROR: Final = 0x20000000
EXTENDED_IDENTIFIER: Final = 0x1FFFFFFF
STANDARD_IDENTIFIER: Final = 0x7FF
FD: Final = 1 << 32
"""Flags of ours, above those: a frame of CAN FD, and one whose data go at a bit rate of their own."""
SWITCHED: Final = 1 << 33
WORD: Final = 0xFFFFFFFF
"""What of an identifier with flags linux/can.h has."""

GONE: Final = frozenset({errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF})
"""Error codes for an interface that is down or away."""
MAX_FRAMES: Final = 512
"""Taken in one drain, so that a flooded bus cannot stall the loop; the rest waits for the next."""
MAX_DATA: Final = 8

Arrival = tuple[int, bytes, int]
"""An identifier with flags, the data, and when it came on the wall clock, ns; 0 where that is not known."""

_FAILURES: Final = 10
"""Drains in a row that end in an error before the bus counts as gone: some backends give no better reason."""
_TOGETHER_NS: Final = 100_000
"""Two clocks that are read within this time give their offset."""
_READINGS: Final = 3
"""Tries at that; the last one counts in any case."""


class PortError(Exception):
    """Sending or receiving failed; `is_gone` where the interface is down or not there any more."""

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


def wire_parts(frame: Frame) -> tuple[int, int, bytes]:
    """A frame's identifier with its flags, the length that it states, and the data that it carries.

    A remote frame carries none; without any data of its own it states all 8 bytes.

    Raises:
        PortError: It is of CAN FD, with a length that no such frame has: what fills it up is up to the protocol.
    """
    word = frame.arbitration_id | (EXTENDED if frame.is_extended else 0)
    if frame.is_fd:
        if len(frame.data) not in FD_LENGTHS:
            raise PortError(f"CAN FD carries no {len(frame.data)} bytes; fill them up to one of {FD_LENGTHS[9:]}")
        return word | FD, len(frame.data), frame.data
    if frame.is_remote:
        return word | REMOTE, len(frame.data) or MAX_DATA, b""
    return word, len(frame.data), frame.data


class CanBus(NamedTuple):
    """Which bus a CAN link is on.

    Attributes:
        description: For people.
        bitrate: In bit/s.
        kernel_name: Of the network interface; None where the bus is not one.
        fd_bitrate: Of the data in frames of CAN FD, bit/s; None where the bus carries classic frames only.
    """

    description: str
    bitrate: int
    kernel_name: str | None
    fd_bitrate: int | None = None


class _Opened(NamedTuple):
    port: CanPort
    at_ns: int
    interface: InterfaceState


class CanLink:
    """A CAN bus as a `Link`, over ports that are opened one after the other as often as the bus comes back.

    A frame's `received_ns` is its own receive stamp moved to the loop's clock, kept between the last drain and now, so
    that neither a step of the wall clock nor a backend with a clock of its own can make a frame look fresh or old.

    A frame that this port sent does not come back: the kernel and the virtual bus keep it from the socket that sent it,
    and python-can marks it. So whatever comes was sent by somebody else, also with an identifier that we send too.

    Attributes:
        description: The interface in use, and what was asked for where that was left open.
        receives_remote: Whether remote frames are handed out too, as simulated devices need; else only counted.
    """

    def __init__(
        self, settings: CanBus, open_port: Callable[[LinkCounters], CanPort], now_ns: NowNs, wall_ns: NowNs
    ) -> None:
        """Describe the bus; `open` opens it, and `open_port` may take its time and raise BusNotFoundError."""
        self.counters = LinkCounters()
        self.description = settings.description
        self.receives_remote = False
        self._settings = settings
        self._open_port = open_port
        self._now_ns = now_ns
        self._wall_ns = wall_ns
        self._port: CanPort | None = None
        self._failures = 0
        self._drained_ns = 0
        self._errors = BusErrors()
        self._interface = InterfaceWatch(settings.kernel_name)
        self._meter = Meter(self.counters, now_ns)
        self._recovery = Recovery(
            f"CAN bus {settings.description}", self._open, lambda opened: opened.port.close(), now_ns
        )

    @property
    def state(self) -> LinkState:
        """What the bus can still do, from its error frames."""
        return self._errors.state if self._port is not None else LinkState.GONE

    @property
    def health(self) -> Mapping[str, str]:
        """State, counts, rates since the last call, what the error frames reported, and what the kernel knows."""
        if self._interface.look(self.counters.error_frames):
            state = self._interface.state
            self._errors.learn(state.state, state.tec, state.rec)
        bitrate = self._interface.state.bitrate or self._settings.bitrate
        return {
            "state": str(self.state),
            **({"lost": self._recovery.reason} if self._recovery.reason else {}),
            **({"reopening": self._recovery.failure} if self._recovery.failure else {}),
            **self.counters.as_text(),
            **self._meter.measure(bitrate),
            **self._errors.as_text(),
            **self._interface.as_text(),
        }

    def open(self) -> None:
        """Open the bus; see `Link.open`."""
        self.close()
        self._use(self._recovery.open())

    def send(self, frame: Frame) -> bool:
        """Queue a frame; see `Link.send`. A full queue drops it: an old command is worse than none."""
        # To a controller that is bus-off the kernel takes frames and drops them, without an error.
        port = self._port
        if port is None or self._errors.state is LinkState.BUS_OFF:
            self.counters.send_dropped += 1
            return False
        try:
            port.send(frame)
        except PortError as error:
            self.counters.send_dropped += 1
            if error.is_gone:
                self._lose(port, error)
            return False
        self._count_sent(frame)
        return True

    def receive(self) -> list[Frame]:
        """Take what has arrived; see `Link.receive`."""
        port = self._port
        if port is None:
            opened = self._recovery.regain()
            self._use(opened)
            self.counters.reopened += 1
            port = opened.port
        frames: list[Frame] = []
        now_ns, offset_ns = self._read_clocks()
        since_ns = self._drained_ns
        try:
            for word, data, stamp_ns in port.drain():
                is_extended = word & EXTENDED != 0
                identifier = word & (EXTENDED_IDENTIFIER if is_extended else STANDARD_IDENTIFIER)
                if word & (ERROR | REMOTE):
                    self._take_other(word, identifier, data, now_ns, frames)
                    continue
                received_ns = stamp_ns + offset_ns
                if not since_ns <= received_ns <= now_ns:
                    received_ns = since_ns if received_ns < since_ns else now_ns
                self.counters.received += 1
                if self._errors.state is LinkState.BUS_OFF:  # a controller that is off receives nothing
                    self._errors.state = LinkState.ACTIVE
                if word < FD:
                    self.counters.bits += worst_case_bits(len(data), is_extended=is_extended)
                    frames.append(Frame(identifier, data, received_ns, is_extended))
                    continue
                self.counters.bits += self._fd_bits(len(data), is_extended=is_extended)
                frames.append(Frame(identifier, data, received_ns, is_extended, is_fd=True))
        except PortError as error:
            self._failures = 1 if frames else self._failures + 1
            if error.is_gone or self._failures >= _FAILURES:
                self._lose(port, error)
                raise self._recovery.lost() from error
            self.counters.undecodable += 1
        else:
            self._failures = 0
        self._drained_ns = now_ns
        return frames

    def close(self) -> None:
        """Close the bus, and whatever is on its way to be opened."""
        self._recovery.end()
        if self._port is not None:
            self._port.close()
            self._port = None

    def _read_clocks(self) -> tuple[int, int]:
        """The loop's clock, and how far it is ahead of that of the stamps, ns.

        Preempted between the one and the other by a millisecond, every frame would look a millisecond older than it is.
        """
        for _ in range(_READINGS):
            now_ns = self._now_ns()
            wall_ns = self._wall_ns()
            if self._now_ns() - now_ns < _TOGETHER_NS:
                break
        return now_ns, now_ns - wall_ns

    def _take_other(self, word: int, identifier: int, data: bytes, now_ns: int, frames: list[Frame]) -> None:
        """What came and is no data frame."""
        # Error frames first: their identifier is a bit field that can equal a data frame's.
        if word & ERROR:
            self.counters.error_frames += 1
            self._errors.take_frame(word & EXTENDED_IDENTIFIER, data)
            return
        asked = Frame(identifier, b"", now_ns, word >= EXTENDED, is_remote=True)
        self.counters.remote_frames += 1
        self.counters.bits += worst_case_bits(0, is_extended=asked.is_extended)
        if self.receives_remote:
            frames.append(asked)

    def _count_sent(self, frame: Frame) -> None:
        self.counters.sent += 1
        if frame.is_fd:
            self.counters.bits += self._fd_bits(len(frame.data), is_extended=frame.is_extended)
            return
        length = 0 if frame.is_remote else len(frame.data)
        self.counters.bits += worst_case_bits(length, is_extended=frame.is_extended)

    def _fd_bits(self, length: int, *, is_extended: bool) -> int:
        """A frame of CAN FD, as bits at the bus's bit rate."""
        slow, fast = worst_case_fd_bits(length, is_extended=is_extended)
        settings = self._settings
        return slow + round(fast * settings.bitrate / (settings.fd_bitrate or settings.bitrate))

    def _open(self) -> _Opened:
        """Open a port; takes its time, and touches nothing that the loop uses."""
        try:
            port = self._open_port(self.counters)
        except OSError as error:
            raise BusNotFoundError(
                f"cannot open CAN bus {self._settings.description}: {error}; check interface and channel"
            ) from error
        return _Opened(port, self._now_ns(), self._interface.read())

    def _use(self, opened: _Opened) -> None:
        self._port, self._drained_ns, state = opened
        self._failures = 0
        self._errors.begin()
        self._interface.begin(state)
        self._errors.learn(state.state, state.tec, state.rec)

    def _lose(self, port: CanPort, error: PortError) -> None:
        self._recovery.lose(port.close, str(error))
        self._port = None
