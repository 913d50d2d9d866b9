# SPDX-License-Identifier: MIT
"""Between the loop's process and the terminal's: keys one way, snapshots the other; neither end ever waits.

And the keys that drive a robot, as a terminal sends them.
"""

import contextlib
import enum
import itertools
import re
import socket
from collections.abc import Iterator
from typing import Final

import msgspec

from segway_ecc.hil.play.keys import KEYS


@enum.unique
class Key(enum.StrEnum):
    """What a person presses, by the acts of `KEYS`; the values travel from the terminal's process to the loop's."""

    UP = "ahead"
    DOWN = "back"
    LEFT = "left"
    RIGHT = "right"
    REST = "rest"
    STOP = "stop"
    ARM = "arm"
    DISARM = "disarm"
    CLEAR_FAULT = "clear_fault"
    STAND = "stand"
    SIT = "sit"
    PUSH = "push"
    CUT = "cut"
    REPAIR = "recover"
    QUIT = "quit"
    ALIVE = "."
    """No key: the terminal is still alive."""


ACTS: Final = frozenset(key.value for key in Key)
"""What a terminal can ask for; the table has more, for the page."""
_SENT: Final = {
    "ArrowUp": (b"\x1b[A", b"\x1bOA"),
    "ArrowDown": (b"\x1b[B", b"\x1bOB"),
    "ArrowRight": (b"\x1b[C", b"\x1bOC"),
    "ArrowLeft": (b"\x1b[D", b"\x1bOD"),
    "Escape": (b"\x1b",),
    "Space": (b" ",),
}
"""Keys that are no letters, as ECMA-48 and as a terminal in application mode sends them."""
_SEQUENCES: Final = {
    **{
        sent: Key(binding.act)
        for binding in KEYS
        if binding.act in ACTS
        for name in binding.keys
        for sent in _SENT.get(name, (name.encode(),))
    },
    b"\x03": Key.QUIT,
    b"\x04": Key.QUIT,
}
"""Ctrl-C and Ctrl-D leave, too."""
_WORD: Final = re.compile(rb"\x1b\[[0-?]*[ -/]*[@-~]|\x1bO.|.", re.DOTALL)
"""A control sequence (ECMA-48, 5.4), a cursor key in application mode, or a byte."""
_BEGUN: Final = re.compile(rb"\x1b(\[[0-?]*[ -/]*|O)?\Z")


def is_begun(data: bytes) -> bool:
    """Whether it ends as a sequence begins: with the escape key, or with the first half of another key."""
    return _BEGUN.search(data) is not None


def keys_in(data: bytes) -> list[Key]:
    """The keys in what was read from a terminal at once; what is no key is passed over.

    Nothing is kept for the next read: an escape that nothing follows is the key that stops.
    """
    return [_SEQUENCES[word] for word in _WORD.findall(data) if word in _SEQUENCES]


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """The robot at one moment.

    Attributes:
        mode: What it is allowed to do.
        linear: Linear velocity ahead, m/s; None where the robot does not publish it.
        angular: Angular velocity, counter-clockwise, rad/s; None where the robot does not publish it.
        wanted_linear: Set-point in force, m/s.
        wanted_angular: Set-point in force, rad/s.
        pitch: Tilt, positive ahead, rad; None where the robot has none.
        posture: What it is doing, where it is one that stands up and sits down; else None.
        battery: Supply voltage, V, by drive.
        links: State of each line to the drives, by its name; empty where there is none.
        line: The line that carries the commands, where there are two; else None.
        timing: How the loop meets its deadlines.
        messages: The last notices, oldest first.
    """

    robot: str
    mode: str
    reason: str
    linear: float | None
    angular: float | None
    wanted_linear: float
    wanted_angular: float
    pitch: float | None
    posture: str | None
    battery: dict[str, str]
    links: dict[str, str]
    line: str | None
    timing: dict[str, str]
    messages: list[str]
    has_ros: bool
    guard_runs: bool
    can_be_pushed: bool
    is_bus_broken: bool


_MOST_AT_ONCE = 32
"""Keys taken in one cycle at most, so that a key that is held down cannot delay the loop."""
_MOST_BYTES = 1 << 16


def channel() -> tuple[socket.socket, socket.socket]:
    """Two ends that keep messages apart and show when the other end is gone."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in ends:
        end.setblocking(False)  # noqa: FBT003 - the standard library's signature
    return ends


class _End:
    """One end; `is_gone` where the other end's process has ended."""

    def __init__(self, end: socket.socket) -> None:
        """Talk over `end`."""
        self.is_gone = False
        self._end = end

    def _arrived(self) -> Iterator[bytes]:
        """The messages that have arrived, oldest first."""
        while not self.is_gone:
            try:
                message = self._end.recv(_MOST_BYTES)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            self.is_gone = not message
            if message:
                yield message


class LoopEnd(_End):
    """The loop's end; `dropped` are snapshots that found no room."""

    dropped = 0

    def pressed(self) -> Iterator[Key]:
        """The keys that were pressed since the last call, oldest first."""
        for message in itertools.islice(self._arrived(), _MOST_AT_ONCE):
            with contextlib.suppress(ValueError):
                yield Key(message.decode("ascii", "replace"))

    def show(self, snapshot: Snapshot) -> None:
        """Hand over a snapshot; one that finds no room is discarded and counted: a newer one follows."""
        try:
            self._end.send(msgspec.msgpack.encode(snapshot))
        except OSError:
            self.dropped += 1


class TerminalEnd(_End):
    """The terminal's end."""

    def press(self, key: Key) -> None:
        """Send a key; where the loop takes none any more it is lost."""
        with contextlib.suppress(OSError):
            self._end.send(key.value.encode())

    def newest(self) -> Snapshot | None:
        """The newest snapshot that has arrived; None where there is none."""
        found = None
        for message in self._arrived():
            found = msgspec.msgpack.decode(message, type=Snapshot)
        return found
