# SPDX-License-Identifier: MIT
"""A serial line that another process has open and reads: what is written here goes out beside what it writes.

Both have a descriptor of the same port. Of what arrives the kernel gives each byte to one reader only, so here none is
read. A write of a few bytes is whole in the port's queue (tty_io.c of Linux: one writer of a terminal at a time).
"""

import contextlib
import os
import select
import termios
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Protocol

from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState, NowNs
from segway_ecc.firmware_io.links.reopening import Recovery
from segway_ecc.firmware_io.links.serial_link import SerialCodec, open_remedy
from segway_ecc.firmware_io.links.settings import PortSettings

_SPEED: Final = 5
_INPUT, _OUTPUT, _CONTROL, _LOCAL = range(4)
_COOKED: Final = termios.ICANON | termios.ECHO


class WritePort(Protocol):
    """What is used of a port that is only written to. Nothing here waits."""

    def write(self, data: bytes, /) -> int:
        """Queue bytes, and return how many; OSError where there is no room, or the port is gone."""

    @property
    def is_there(self) -> bool:
        """Whether the port has not gone."""

    def close(self) -> None:
        """Close it."""


class TerminalPort:
    """A port of this machine, opened to be written to; see `WritePort`."""

    def __init__(self, settings: PortSettings) -> None:
        """Open it; its rate and its raw mode are set where nobody has set them yet.

        Raises:
            OSError: It is not there, cannot be used, or has no such rate.
        """
        speed = getattr(termios, f"B{settings.baudrate}", None)
        if "://" in settings.port or speed is None:
            raise OSError(None, "only a port of this machine, at one of its rates, can be written to by two programs")
        self._fileno = os.open(Path(settings.port), os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            self._make_raw(speed)
        except termios.error as error:
            os.close(self._fileno)
            raise OSError(*error.args) from error
        self._poll = select.poll()
        self._poll.register(self._fileno, 0)

    def write(self, data: bytes, /) -> int:
        """Queue bytes; see `WritePort.write`."""
        return os.write(self._fileno, data)

    @property
    def is_there(self) -> bool:
        """Whether the kernel reports no hang-up."""
        return not self._poll.poll(0)

    def close(self) -> None:
        """Close it."""
        with contextlib.suppress(OSError):
            os.close(self._fileno)

    def _make_raw(self, speed: int) -> None:
        modes = termios.tcgetattr(self._fileno)
        if modes[_SPEED] == speed and not modes[_LOCAL] & _COOKED:
            return
        modes[_INPUT] = modes[_OUTPUT] = modes[_LOCAL] = 0
        modes[_CONTROL] = termios.CS8 | termios.CREAD | termios.CLOCAL
        modes[_SPEED - 1] = modes[_SPEED] = speed
        termios.tcsetattr(self._fileno, termios.TCSANOW, modes)


class SerialWriter:
    """The guard's end of the node's serial line; see `Link`. It receives nothing.

    Attributes:
        counters: What was sent; a byte counts as ten bits.
    """

    def __init__(
        self,
        settings: PortSettings,
        codec: SerialCodec,
        now_ns: NowNs,
        open_port: Callable[[PortSettings], WritePort] = TerminalPort,
    ) -> None:
        """Describe the line; `open` opens its port."""
        self.counters = LinkCounters()
        self.description = f"serial {settings.port} at {settings.baudrate} bit/s, to write on"
        self._settings = settings
        self._codec = codec
        self._port: WritePort | None = None
        self._open_port = open_port
        self._recovery: Recovery[WritePort] = Recovery(
            self.description, lambda: open_port(settings), _close, now_ns, remedy="plug it in again"
        )

    @property
    def state(self) -> LinkState:
        """Whether the port is there."""
        return LinkState.ACTIVE if self._port is not None else LinkState.GONE

    @property
    def health(self) -> Mapping[str, str]:
        """State and counts."""
        return {"state": str(self.state), **self.counters.as_text()}

    def open(self) -> None:
        """Open the port; see `Link.open`."""
        self.close()
        try:
            self._port = self._recovery.open()
        except OSError as error:
            reason = error.strerror or str(error)
            raise BusNotFoundError(
                f"cannot open {self.description}: {reason}; {open_remedy(self._settings, error)}"
            ) from error

    def send(self, frame: Frame) -> bool:
        """Send a frame's packet; see `Link.send`."""
        port, packet = self._port, self._codec.encode(frame)
        was_sent = False
        if port is not None and packet is not None:
            with contextlib.suppress(OSError):
                port.write(packet)
                was_sent = True
                self.counters.bits += 10 * len(packet)
        self.counters.sent += was_sent
        self.counters.send_dropped += not was_sent
        return was_sent

    def receive(self) -> list[Frame]:
        """Nothing, while the port is there; see `Link.receive`."""
        port = self._port
        if port is None:
            self._port = self._recovery.regain()
            self.counters.reopened += 1
        elif not port.is_there:
            self._port = None
            self._recovery.lose(port.close, "it was unplugged")
            raise self._recovery.lost()
        return []

    def close(self) -> None:
        """Close the port, and whatever is on its way to be opened."""
        self._recovery.end()
        if self._port is not None:
            self._port.close()
            self._port = None


def _close(port: WritePort) -> None:
    port.close()
