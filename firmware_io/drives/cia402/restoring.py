# SPDX-License-Identifier: MIT
"""Setting up again a drive that has restarted: in the loop, one request a cycle, without waiting."""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from segway_ecc.firmware_io.drives.cia402.settings import ANSWER_WITHIN_NS

_READ: Final = 0x40
"""The specifier of a request to read."""


class Exchange(NamedTuple):
    """An SDO request, and what the drive answered."""

    request: bytes
    answer: bytes


class Restoring:
    """Asks a drive again what it was asked when it was set up, and is content with the same answers only.

    The set-up begins with the drive as it is after a reset, so the answers are the same if the drive is. A value that
    is read may take a moment to become what it was: reading is repeated until the time is up.

    Attributes:
        failure: Why the drive could not be set up again; None where it was, or nothing was tried.
    """

    def __init__(self, exchanges: Sequence[Exchange], now_ns: Callable[[], int]) -> None:
        """Remember how the drive was set up; nothing is to be done until `begin`."""
        self.failure: str | None = None
        self._exchanges = tuple(exchanges)
        self._now_ns = now_ns
        self._place = len(self._exchanges)
        self._deadline_ns = 0
        self._is_waiting = False

    @property
    def is_under_way(self) -> bool:
        """Whether the drive is not yet what it was."""
        return self.failure is None and self._place < len(self._exchanges)

    def begin(self) -> None:
        """The drive has lost its set-up; start from the beginning."""
        self.failure = None
        self._place = 0
        self._is_waiting = False
        self._deadline_ns = 0

    def next_request(self) -> bytes | None:
        """What to send in this cycle; None where there is nothing to send, or an answer is waited for."""
        if not self.is_under_way:
            return None
        now_ns = self._now_ns()
        if self._deadline_ns and now_ns > self._deadline_ns:
            self.failure = f"{_object(self._exchanges[self._place].request)} is not answered as it was"
            return None
        if self._is_waiting:
            return None
        self._is_waiting = True
        self._deadline_ns = self._deadline_ns or now_ns + ANSWER_WITHIN_NS
        return self._exchanges[self._place].request

    def take_answer(self, answer: bytes) -> bool:
        """Take an SDO answer; False where none was waited for."""
        if not (self.is_under_way and self._is_waiting):
            return False
        request, expected = self._exchanges[self._place]
        self._is_waiting = False
        if answer == expected:
            self._place += 1
            self._deadline_ns = 0
        elif request[0] != _READ:
            self.failure = f"{_object(request)} is not answered as it was"
        return True


def _object(request: bytes) -> str:
    """The object that a request is about, for people."""
    return f"object 0x{int.from_bytes(request[1:3], 'little'):04X}:{request[3]:02X}"
