# SPDX-License-Identifier: MIT
"""A serial line in real time without hardware: a pseudo-terminal that the robot opens by a name of our choice."""

import contextlib
import fcntl
import os
import struct
import termios
import tty
from pathlib import Path
from typing import Final

_INT: Final = struct.Struct("i")


class PtyPort:
    """The device's end of a pseudo-terminal; see `Port`. The robot opens the other end at `path`, a symbolic link.

    It has no rate: bytes arrive at once. While it is unplugged what the device sends is lost, and it receives nothing.
    """

    def __init__(self, path: Path) -> None:
        """Make a pseudo-terminal, raw, with a link to it at `path`.

        Raises:
            FileExistsError: There is something other than a symbolic link at `path`.
        """
        self.path = path
        self._ours: int | None = None
        self._robots: int | None = None
        self.plug()

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
        if self.path.is_symlink():
            self.path.unlink()
        try:
            self.path.symlink_to(os.ttyname(robots))
        except OSError:
            os.close(robots)
            os.close(ours)
            raise
        self._ours, self._robots = ours, robots

    def unplug(self) -> None:
        """Pull the adapter out: the robot's reads and writes fail, and the name is gone."""
        if self._ours is None or self._robots is None:
            return
        with contextlib.suppress(OSError):
            # Another rig may have taken the name over.
            if str(self.path.readlink()) == os.ttyname(self._robots):
                self.path.unlink()
        os.close(self._robots)
        os.close(self._ours)
        self._ours = self._robots = None

    def close(self) -> None:
        """Remove the pseudo-terminal and the link to it; may be called again."""
        self.unplug()
