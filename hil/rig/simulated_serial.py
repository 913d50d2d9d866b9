# SPDX-License-Identifier: MIT
"""A serial line in simulated time: each byte arrives when its ten bits have passed; and one in real time.

That is a pseudo-terminal, which the robot opens by a name of our choice, or a real port that is served.
"""

import contextlib
import errno
import fcntl
import hashlib
import os
import socket
import stat
import struct
import termios
import tty
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.serial_link import Port, open_remedy, open_serial_port
from segway_ecc.firmware_io.links.settings import PortSettings
from segway_ecc.hil.errors import SerialNameError
from segway_ecc.hil.rig.simulated_bus import NowNs

_INT: Final = struct.Struct("i")
_NS_PER_S: Final = 1_000_000_000
_BITS_PER_BYTE: Final = 10
_MOST_QUEUED: Final = 4096
"""Bytes that a port takes ahead of the line, as the driver of a real one does."""
_MOST_KEPT: Final = 65_536
"""Bytes that wait to be read; a real port loses what comes after as well."""
_TERMINALS: Final = "/dev/pts/"
_OWN_TERMINALS: Final = "/dev/pts/../pts/"
"""The same folder, as only our links spell it: one that was left behind is known by that, also where the terminal that
it names has gone, or is somebody else's by now."""


class SimulatedSerial:
    """Two ports joined by two wires, one each way: `host` is the robot's, `device` that of what it talks to."""

    def __init__(self, baudrate: int, now_ns: NowNs) -> None:
        """Join two ports at `baudrate` bit/s on a simulated clock."""
        self._cut = False
        forth, back = (_Wire(baudrate, now_ns) for _ in range(2))
        self.host = SimulatedPort(back, forth)
        self.device = SimulatedPort(forth, back)
        self._wires = (forth, back)

    @property
    def cut(self) -> bool:
        """Whether the wires are cut; what is on them then, and what is sent meanwhile, vanishes."""
        return self._cut

    @cut.setter
    def cut(self, is_cut: bool) -> None:
        """Cut the wires, or join them again."""
        for wire in self._wires:
            wire.pass_on()
            wire.is_cut = is_cut
        self._cut = is_cut


class _Wire:
    """One way of a line."""

    def __init__(self, baudrate: int, now_ns: NowNs) -> None:
        self.is_cut = False
        self.arrived = bytearray()
        self._ns_per_byte = _NS_PER_S * _BITS_PER_BYTE / baudrate
        self._now_ns = now_ns
        self._begun_ns = 0
        self._sent = 0
        self._under_way: deque[tuple[int, int]] = deque()

    @property
    def queued(self) -> int:
        """Bytes that have not passed yet."""
        self.pass_on()
        return len(self._under_way)

    def put(self, data: bytes) -> int:
        """Queue bytes; how many there was room for."""
        room = _MOST_QUEUED - self.queued
        if not self._under_way:
            self._begun_ns, self._sent = self._now_ns(), 0
        for byte in data[:room]:
            self._sent += 1
            # From the beginning of the run, so that what is rounded off does not add up.
            self._under_way.append((self._begun_ns + round(self._sent * self._ns_per_byte), byte))
        return min(len(data), room)

    def pass_on(self) -> None:
        """Hand over, or lose where the wire is cut, everything that has passed by now."""
        now_ns = self._now_ns()
        while self._under_way and self._under_way[0][0] <= now_ns:
            _, byte = self._under_way.popleft()
            if not self.is_cut:
                self.keep(bytes((byte,)))

    def keep(self, data: bytes) -> None:
        """Let bytes wait to be read."""
        self.arrived += data[: _MOST_KEPT - len(self.arrived)]


class SimulatedPort:
    """One end of a simulated line; see `Port`."""

    def __init__(self, incoming: _Wire, outgoing: _Wire) -> None:
        """Join two wires; use `SimulatedSerial`."""
        self._incoming = incoming
        self._outgoing = outgoing
        self._is_there = True

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived."""
        self._check()
        self._incoming.pass_on()
        return len(self._incoming.arrived)

    @property
    def out_waiting(self) -> int:
        """Bytes that have not passed yet."""
        self._check()
        return self._outgoing.queued

    @property
    def is_there(self) -> bool:
        """Whether it is plugged in."""
        return self._is_there

    def read(self, size: int, /) -> bytes:
        """Take up to `size` of the bytes that have arrived."""
        count = min(size, self.in_waiting)
        data = bytes(self._incoming.arrived[:count])
        del self._incoming.arrived[:count]
        return data

    def write(self, data: bytes, /) -> int:
        """Queue bytes; how many there was room for."""
        self._check()
        return self._outgoing.put(data)

    def open(self, _settings: PortSettings) -> "SimulatedPort":
        """This port with nothing in it, for `SerialLink` to open as often as it has to.

        Raises:
            OSError: It is unplugged.
        """
        if not self._is_there:
            raise FileNotFoundError(errno.ENOENT, "the simulated port is unplugged")
        self._incoming.pass_on()
        self._incoming.arrived.clear()
        return self

    def close(self) -> None:
        """Stop using the port; it stays where it is."""

    def unplug(self) -> None:
        """From now on reading and writing raise OSError, as with an adapter that is pulled out."""
        self._is_there = False

    def plug(self) -> None:
        """Put the port back."""
        self._is_there = True

    def inject(self, data: bytes) -> None:
        """Noise: bytes that nobody sent arrive now, in the middle of whatever is on its way."""
        self._incoming.pass_on()
        self._incoming.keep(data)

    def _check(self) -> None:
        if not self._is_there:
            raise OSError(errno.EIO, "the simulated port is unplugged")


class PtyPort:
    """The device's end of a pseudo-terminal; see `Port`. The robot opens the other end at `path`, a symbolic link.

    It has no rate: bytes arrive at once. While it is unplugged what the device sends is lost, and it receives nothing.
    """

    def __init__(self, path: Path) -> None:
        """Make a pseudo-terminal, raw, with a link to it at `path`.

        A link that a rig left behind when it was killed is replaced; nothing else is.

        Raises:
            SerialNameError: There is something else at `path`, or the link of a rig that runs.
            OSError: The link cannot be made.
        """
        self.path = path
        self._ours: int | None = None
        self._robots: int | None = None
        self._claim = _claim(path)
        try:
            if _is_own(path):
                path.unlink()
            self.plug()
        except BaseException:
            self._claim.close()
            raise

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived."""
        if self._ours is None:
            return 0
        return int(_INT.unpack(fcntl.ioctl(self._ours, termios.FIONREAD, bytes(_INT.size)))[0])

    def read(self, size: int, /) -> bytes:
        """Take up to `size` bytes."""
        with contextlib.suppress(BlockingIOError):
            return b"" if self._ours is None else os.read(self._ours, size)
        return b""

    def write(self, data: bytes, /) -> int:
        """Queue bytes; how many there was room for."""
        with contextlib.suppress(BlockingIOError):
            return len(data) if self._ours is None else os.write(self._ours, data)
        return 0

    def plug(self) -> None:
        """Put the adapter in: a new pseudo-terminal under the same name."""
        if self._ours is not None:
            return
        # The robot's end stays open here as well, so that ours is not hung up while the robot is away.
        ours, robots = os.openpty()
        os.set_blocking(ours, False)
        tty.setraw(robots)
        try:
            self.path.symlink_to(_link_text(robots))
        except OSError as error:
            os.close(robots)
            os.close(ours)
            if isinstance(error, FileExistsError):
                raise SerialNameError(
                    f"cannot make a serial line at {self.path}: it exists and is not a link that a plant made; "
                    "name another path, or remove it yourself"
                ) from error
            raise
        self._ours, self._robots = ours, robots

    def unplug(self) -> None:
        """Pull the adapter out: the robot's reads and writes fail, and the name is gone."""
        if self._ours is None or self._robots is None:
            return
        with contextlib.suppress(OSError):
            # Somebody may have put something else there.
            if str(self.path.readlink()) == _link_text(self._robots):
                self.path.unlink()
        os.close(self._robots)
        os.close(self._ours)
        self._ours = self._robots = None

    def close(self) -> None:
        """Remove the pseudo-terminal and the link to it; may be called again."""
        self.unplug()
        self._claim.close()


class ServedPort:
    """A real serial port with the device's end of it here; see `Port`. The robot is at the other end of its cable."""

    def __init__(self, settings: PortSettings) -> None:
        """Open the port at its rate, for this program alone.

        Raises:
            OSError: It cannot be opened.
        """
        self._name = settings.port
        self._port = open_serial_port(settings)

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived; LinkLostError where the port is gone, as `read` and `write`."""
        with self._reported_loss():
            return self._port.in_waiting

    def read(self, size: int, /) -> bytes:
        """Take up to `size` bytes."""
        with self._reported_loss():
            return self._port.read(size)

    def write(self, data: bytes, /) -> int:
        """Queue bytes; how many there was room for."""
        with self._reported_loss():
            return self._port.write(data)

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    @contextlib.contextmanager
    def _reported_loss(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise LinkLostError(f"serial port {self._name} is gone: {error}; plug it in, and start again") from error


def serve_serial(settings: PortSettings) -> Port:
    """The device's end of the serial line that a robot file names.

    A port that is there, or a URL, is opened at its rate: the robot is at the other end of its cable. A path that
    does not exist becomes a pseudo-terminal, which the robot opens by that path.

    Raises:
        SerialNameError: The path is something else, another plant's, or cannot be opened or made.
    """
    path = Path(settings.port)
    try:
        if "://" in settings.port or (_is_terminal(path) and not _is_own(path)):
            return ServedPort(settings)
    except OSError as error:
        raise SerialNameError(
            f"cannot serve {settings.port}: {error.strerror or error}; {open_remedy(settings, error)}"
        ) from error
    try:
        return PtyPort(path)
    except OSError as error:
        raise SerialNameError(f"cannot make a serial line at {path}: {error.strerror}") from error


def _is_terminal(path: Path) -> bool:
    """Whether there is a character device at a path, as a serial port is, or a link to one."""
    try:
        return stat.S_ISCHR(path.stat().st_mode)
    except OSError:
        return False


def _is_own(path: Path) -> bool:
    return path.is_symlink() and str(path.readlink()).startswith(_OWN_TERMINALS)


def _link_text(robots: int) -> str:
    """What our link to a pseudo-terminal says."""
    return os.ttyname(robots).replace(_TERMINALS, _OWN_TERMINALS, 1)


def _claim(path: Path) -> socket.socket:
    """Hold a path against other rigs for as long as this process lives: by an abstract socket, as a bus (unix(7))."""
    place = os.fsencode(path.parent.resolve() / path.name)
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        claim.bind(f"\0segway-ecc-serial-{hashlib.sha256(place).hexdigest()[:16]}")
    except OSError as error:
        claim.close()
        raise SerialNameError(
            f"cannot make a serial line at {path}: another plant serves it; stop that one first"
        ) from error
    return claim
