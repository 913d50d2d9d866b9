# SPDX-License-Identifier: MIT
"""The loop's heartbeat to the guard, for when its commands do not go over the bus: a datagram that never blocks."""

import hashlib
import socket
from collections.abc import Iterator
from typing import Final, Protocol

from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.firmware_io.links.can_interfaces import resolve
from segway_ecc.firmware_io.links.settings import CanSettings

_ON: Final = b"\x01"
_OFF: Final = b"\x00"
_TAKEN_AT_ONCE: Final = 64
_SKIPPED_AFTER_REFUSAL: Final = 9
"""Heartbeats that are skipped after one that no guard was there to take: each would cost as much as a command."""


class GuardRunsError(HardwareError):
    """Another guard watches the same bus."""


class GuardHeartbeat(Protocol):
    """The loop's side of it."""

    def beat(self, *, is_on: bool) -> None:
        """Signal that the loop runs, and whether it wants the motors on."""

    def close(self) -> None:
        """Give back what it holds."""


def address_of(can: CanSettings) -> str:
    """The address of a bus' guard, in the kernel's abstract namespace (unix(7)): it leaves no file behind."""
    digest = hashlib.sha256(" ".join(resolve(can.interface, can.channel)).encode()).hexdigest()
    return f"\0segway-ecc-guard-{digest[:16]}"


class _HeartbeatSocket:
    def __init__(self, can: CanSettings) -> None:
        self._address = address_of(can)
        self._socket: socket.socket | None = None

    def close(self) -> None:
        """Close the socket; it may be opened again."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class HeartbeatSender(_HeartbeatSocket):
    """Sends to the guard of a bus; see `GuardHeartbeat`. One that nobody receives, or has no room, is dropped."""

    def __init__(self, can: CanSettings) -> None:
        """Send to the guard of `can`; the socket is opened with the first heartbeat."""
        super().__init__(can)
        self._skipped = 0

    def beat(self, *, is_on: bool) -> None:
        """Send one; see `GuardHeartbeat.beat`."""
        if self._skipped:
            self._skipped -= 1
            return
        if self._socket is None:
            self._socket = _datagrams()
        try:
            self._socket.sendto(_ON if is_on else _OFF, self._address)
        except ConnectionRefusedError:
            self._skipped = _SKIPPED_AFTER_REFUSAL
        except OSError:  # a guard that does not keep up must not disturb the loop either
            return


class HeartbeatListener(_HeartbeatSocket):
    """The guard's side: takes the heartbeats of whoever commands on a bus."""

    def open(self) -> None:
        """Listen.

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
        self._socket = opened

    def take_heartbeats(self) -> Iterator[bool]:
        """Of each heartbeat that has arrived, oldest first, whether the motors are wanted on; strange ones are not."""
        if self._socket is None:
            return
        for _ in range(_TAKEN_AT_ONCE):
            try:
                word = self._socket.recv(len(_ON) + 1)
            except OSError:
                return
            if word in (_ON, _OFF):
                yield word == _ON


def _datagrams() -> socket.socket:
    made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    made.setblocking(False)  # noqa: FBT003 - the standard library's signature
    return made
