# SPDX-License-Identifier: MIT
"""Who controls a bus, and the heartbeats between its node and its guard: sockets on this machine that never block.

Their names are in the kernel's abstract namespace (unix(7)), which leaves no file behind, and follow from the bus. Who
holds the node's name owns the bus. The guard makes a key at each start and sends it to that name, so that nobody but
the owner learns it; a heartbeat carries a counter and a code that only that key gives.
"""

import contextlib
import hashlib
import hmac
import os
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final, Protocol

from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.firmware_io.links.can_interfaces import resolve
from segway_ecc.firmware_io.links.link import NowNs
from segway_ecc.firmware_io.links.settings import CanSettings, PortSettings

_HEAD: Final = struct.Struct("<QB")
"""The counter, which is the monotonic time at which it was sent, ns, and whether the motors are wanted on."""
_KEY_BYTES: Final = 16
_CODE_BYTES: Final = 8
_BEAT_BYTES: Final = _HEAD.size + _CODE_BYTES
_NO_KEY: Final = bytes(_KEY_BYTES)
_TEXT_BYTES: Final = 200
_TAKEN_AT_ONCE: Final = 64
_SKIPPED_AFTER_REFUSAL: Final = 9
"""Heartbeats that are skipped after one that no guard was there to take: each would cost as much as a command."""
_ANSWERS_WITHIN_NS: Final = 100_000_000
"""A guard that has not answered for longer does not watch."""
_REFUSED_AT_ONCE: Final = 4096
_COMMAND_LINE_SHOWN: Final = 80
_PAUSE_S: Final = 0.01
_PEER: Final = struct.Struct("3i")
"""`struct ucred`: process, user, group."""


class GuardRunsError(HardwareError):
    """Another guard watches the same bus."""


class BusOwnedError(HardwareError):
    """Another controller owns the same bus."""


class Ownership(Protocol):
    """A node's hold on its bus, and what it knows of the guard there.

    Attributes:
        needs_guard: Whether the robot arms only while a guard answers.
        stops: Why the guard stops the drives, or has done since the last heartbeat; empty where it did not.
    """

    needs_guard: bool
    stops: str

    def open(self) -> None:
        """Claim the bus.

        Raises:
            BusOwnedError: Another controller owns it.
        """

    def pause(self) -> None:
        """Wait a moment before the bus is looked at again; only before the loop runs."""

    def beat(self, *, is_on: bool) -> None:
        """Take what the guard answered, and send that the loop runs, and whether it wants the motors on."""

    @property
    def has_guard(self) -> bool:
        """Whether a guard answers."""

    def close(self) -> None:
        """Give the bus back."""


def name_of(line: CanSettings | PortSettings) -> str:
    """What a bus, or a serial line in place of one, is known by on this machine: the port's, as it is named."""
    if isinstance(line, CanSettings):
        return " ".join(resolve(line.interface, line.channel))
    if "://" in line.port:
        return f"serial {line.port}"
    # The name stays where the adapter is unplugged and found again under another number.
    path = Path(line.port)
    return f"serial {path.parent.resolve() / path.name}"


def address_of(line: CanSettings | PortSettings, role: str = "guard") -> str:
    """The address of a bus' `guard` or `node`."""
    digest = hashlib.sha256(name_of(line).encode()).hexdigest()
    return f"\0segway-ecc-{role}-{digest[:16]}"


def code_of(key: bytes, head: bytes) -> bytes:
    """The code of a heartbeat: keyed BLAKE2s (RFC 7693), truncated to 64 bits."""
    return hashlib.blake2s(head, key=key, digest_size=_CODE_BYTES).digest()


class BusOwner:
    """Owns a bus and sends heartbeats to its guard; see `Ownership`. One that cannot be taken at once is dropped."""

    def __init__(
        self, line: CanSettings | PortSettings, now_ns: NowNs = time.monotonic_ns, *, needs_guard: bool = False
    ) -> None:
        """Own a bus, or the serial line in place of one, from `open` on."""
        self.needs_guard = needs_guard
        self.stops = ""
        self._name = name_of(line)
        self._address = address_of(line, "node")
        self._guard = address_of(line)
        self._guard_name = self._guard.encode()  # as the kernel gives it
        self._now_ns = now_ns
        self._lock: socket.socket | None = None
        self._socket: socket.socket | None = None
        self._key = _NO_KEY
        self._answered_ns: int | None = None
        self._skipped = 0

    def open(self) -> None:
        """Claim the bus; see `Ownership.open`."""
        self.close()
        # A listening socket lets the kernel name the process that holds it, even one that is stopped.
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        made = _datagrams()
        try:
            lock.bind(self._address)
            lock.listen(_REFUSED_AT_ONCE)
            made.bind(self._address)
        except OSError as error:
            lock.close()
            made.close()
            raise BusOwnedError(
                f"bus '{self._name}' is controlled by {self._owner()}: a bus has one controller; stop that one first"
            ) from error
        self._lock, self._socket = lock, made

    def pause(self) -> None:
        """See `Ownership.pause`."""
        time.sleep(_PAUSE_S)

    def beat(self, *, is_on: bool) -> None:
        """See `Ownership.beat`."""
        sock = self._socket
        if sock is None:
            return
        self._receive(sock)
        if self._skipped:
            self._skipped -= 1
            return
        head = _HEAD.pack(self._now_ns(), is_on)
        try:
            sock.sendto(head + code_of(self._key, head), self._guard)
        except ConnectionRefusedError:
            self._skipped = _SKIPPED_AFTER_REFUSAL
            self._answered_ns = None
            self.stops = ""
        except OSError:  # a guard that does not keep up must not disturb the loop either
            return

    @property
    def has_guard(self) -> bool:
        """See `Ownership.has_guard`."""
        return self._answered_ns is not None and self._now_ns() - self._answered_ns <= _ANSWERS_WITHIN_NS

    def close(self) -> None:
        """Give the bus back; it may be claimed again."""
        for each in (self._lock, self._socket):
            if each is not None:
                each.close()
        self._lock = self._socket = self._answered_ns = None
        self._key, self._skipped, self.stops = _NO_KEY, 0, ""

    def _receive(self, sock: socket.socket) -> None:
        """Take the guard's answers; one that it stops the drives counts, also where it has ended that since."""
        stops = None
        for _ in range(_TAKEN_AT_ONCE):
            try:
                answer, sender = sock.recvfrom(_KEY_BYTES + _TEXT_BYTES)
            except OSError:
                break
            if sender == self._guard_name and len(answer) >= _KEY_BYTES:
                self._key = answer[:_KEY_BYTES]
                stops = answer[_KEY_BYTES:].decode(errors="replace") or stops or ""
        if stops is not None:
            self.stops, self._answered_ns, self._skipped = stops, self._now_ns(), 0

    def _owner(self) -> str:
        """The process that holds the address, as the kernel names it."""
        pid, words = 0, list[bytes]()
        asking = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        with contextlib.suppress(OSError), asking:
            asking.connect(self._address)
            pid = _PEER.unpack(asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size))[0]
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
        if not pid:
            return "another process"
        line = " ".join(word.decode(errors="replace") for word in words if word)[-_COMMAND_LINE_SHOWN:]
        return f"process {pid}" + (f" ({line})" if line else "")


class HeartbeatListener:
    """The guard's side: takes the heartbeats of the owner of a bus, and answers them.

    `refused` counts what was none of the owner: without the code, or not newer than the last.
    """

    def __init__(self, line: CanSettings | PortSettings) -> None:
        """Take those of a bus, or of the serial line in place of one, from `open` on."""
        self.refused = 0
        self._address = address_of(line)
        self._owner = address_of(line, "node")
        self._socket: socket.socket | None = None
        self._key = _NO_KEY
        self._counter = 0
        self._is_asked = False
        self._answered = ""

    def open(self) -> None:
        """Listen, with a new key, and announce it to the owner.

        Raises:
            GuardRunsError: Somebody listens there already.
        """
        self.close()
        opened = _datagrams()
        try:
            opened.bind(self._address)
        except OSError as error:
            opened.close()
            raise GuardRunsError(f"a guard of this bus already runs ({error.strerror}); stop that one first") from error
        self._socket, self._key, self._counter = opened, os.urandom(_KEY_BYTES), 0
        self.answer("")

    def take_heartbeats(self) -> Iterator[bool]:
        """Of each of the owner's heartbeats that has arrived, oldest first, whether the motors are wanted on."""
        if self._socket is None:
            return
        for _ in range(_TAKEN_AT_ONCE):
            try:
                beat = self._socket.recv(_BEAT_BYTES + 1)
            except OSError:
                return
            self._is_asked = True
            head = beat[: _HEAD.size]
            if len(beat) != _BEAT_BYTES or not hmac.compare_digest(code_of(self._key, head), beat[_HEAD.size :]):
                self.refused += 1
                continue
            counter, is_on = _HEAD.unpack(head)
            if counter <= self._counter:
                self.refused += 1
                continue
            self._counter = counter
            yield bool(is_on)

    def answer(self, stops: str) -> None:
        """Answer what arrived since the last answer, with why the drives are being stopped; empty where they are not.

        Unasked, what has changed, and the key for as long as nobody has used it.
        """
        if self._socket is None or not (self._is_asked or stops != self._answered or not self._counter):
            return
        self._is_asked = False
        with contextlib.suppress(OSError):  # there is no owner, or it does not keep up
            self._socket.sendto(self._key + stops.encode()[:_TEXT_BYTES], self._owner)
            self._answered = stops

    def close(self) -> None:
        """Stop listening; it may begin again."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _datagrams() -> socket.socket:
    made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    made.setblocking(False)  # noqa: FBT003 - the standard library's signature
    return made
