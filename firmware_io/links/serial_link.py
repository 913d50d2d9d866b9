# SPDX-License-Identifier: MIT
"""A serial line through pyserial, on any URL it offers, which carries the frames of one drive family."""

import operator
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Final, Protocol

from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState, Meter, NowNs
from segway_ecc.firmware_io.links.reopening import Recovery
from segway_ecc.firmware_io.links.serial_port import open_remedy, open_serial_port
from segway_ecc.firmware_io.links.settings import SerialSettings

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
    """A serial protocol as a codec: bytes to the frames of a drive family and back. It knows no port.

    Attributes:
        refused: What was received and not taken, by cause.
    """

    refused: Counter[str]

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


OpenPort = Callable[[SerialSettings], Port]
"""Opens a port, may take its time, and raises OSError where it cannot."""


class SerialLink:
    """A link over one serial line; see `Link` and `StandbyLink`.

    The drives' telemetry is requested; the answer to a request is read in the next cycle. A command that the
    port has no room for is dropped: an old command is worse than none. Of a packet that went out in part the rest goes
    first next time, so that what follows is whole; where it is too old for that, the other end refuses the half.

    Frames are stamped when they are read, so they are up to one cycle older than they look.

    Attributes:
        counters: What passed over it; a byte counts as ten bits.
        description: The port and its rate.
        is_active: Whether it carries the robot's commands, and so asks in every cycle instead of ten times a second.
    """

    def __init__(
        self, settings: SerialSettings, codec: SerialCodec, now_ns: NowNs, open_port: OpenPort = open_serial_port
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
        else:
            self._unwritten = self._unwritten[written:]
        return was_begun

    def _use(self, port: Port) -> None:
        self._port = port
        self._unwritten = b""
        self._asked_ns = None
        self._codec.reset()

    def _lose(self, port: Port, error: OSError) -> None:
        self._recovery.lose(port.close, _text(error))
        self._port = None


def _text(error: OSError) -> str:
    """The text of a port's error, without the number that pyserial puts before it; never empty."""
    return (str(error.args[-1]) if error.args else "") or type(error).__name__
