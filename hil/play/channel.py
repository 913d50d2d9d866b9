"""Between the loop's process and the terminal's: keys one way, snapshots the other; neither end ever waits."""

import contextlib
import socket
from collections.abc import Iterator

import msgspec

from segway_ecc.hil.play.keys import Key
from segway_ecc.hil.play.snapshot import Snapshot

_MOST_AT_ONCE = 32
"""Keys taken in one cycle at most, so that a key that is held down cannot delay the loop."""
_MOST_BYTES = 1 << 16


def channel() -> tuple[socket.socket, socket.socket]:
    """Two ends that keep messages apart and show when the other end is gone."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in ends:
        end.setblocking(False)  # noqa: FBT003 - the standard library's signature
    return ends


class LoopEnd:
    """The loop's end.

    Attributes:
        is_gone: Whether the terminal's process has ended.
        dropped: Snapshots that found no room.
    """

    def __init__(self, end: socket.socket) -> None:
        """Talk over `end`."""
        self.is_gone = False
        self.dropped = 0
        self._end = end

    def pressed(self) -> Iterator[Key]:
        """The keys that were pressed since the last call, oldest first."""
        for _ in range(_MOST_AT_ONCE):
            try:
                message = self._end.recv(16)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            if not message:
                self.is_gone = True
                return
            with contextlib.suppress(ValueError):
                yield Key(message.decode("ascii", "replace"))

    def show(self, snapshot: Snapshot) -> None:
        """Hand over a snapshot; one that finds no room is dropped: a newer one follows."""
        try:
            self._end.send(msgspec.msgpack.encode(snapshot))
        except OSError:
            self.dropped += 1


class TerminalEnd:
    """The terminal's end.

    Attributes:
        is_gone: Whether the loop's process has ended.
    """

    def __init__(self, end: socket.socket) -> None:
        """Talk over `end`."""
        self.is_gone = False
        self._end = end

    def press(self, key: Key) -> None:
        """Send a key; where the loop takes none any more it is lost."""
        with contextlib.suppress(OSError):
            self._end.send(key.value.encode())

    def newest(self) -> Snapshot | None:
        """The newest snapshot that has arrived; None where there is none."""
        found = None
        while not self.is_gone:
            try:
                message = self._end.recv(_MOST_BYTES)
            except BlockingIOError:
                break
            except OSError:
                message = b""
            if message:
                found = msgspec.msgpack.decode(message, type=Snapshot)
            else:
                self.is_gone = True
        return found
