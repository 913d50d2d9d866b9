# SPDX-License-Identifier: MIT
"""Work that may take its time, done off the loop."""

import _thread
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import NowNs

T = TypeVar("T")

RETRY_NS: Final = 100_000_000
"""A lost bus is opened again at most this often."""


class BackgroundTask(Generic[T]):
    """One call in a thread of its own, whose outcome is looked for and never waited for."""

    def __init__(self, work: Callable[[], T], discard: Callable[[T], None] = lambda _: None) -> None:
        """Start `work`; what it made is given to `discard` if nobody wants it any more."""
        self._work = work
        self._discard = discard
        self._outcomes: deque[T | Exception] = deque()
        self._is_abandoned = False
        # Not threading.Thread: its start waits until the new thread runs.
        _thread.start_new_thread(self._run, ())

    def take_outcome(self) -> T | Exception | None:
        """What it made, or what it failed with, once; None before it has ended."""
        try:
            return self._outcomes.popleft()
        except IndexError:
            return None

    def abandon(self) -> None:
        """Want no outcome any more; may be called at any time."""
        self._is_abandoned = True
        self._discard_outcome()

    def _run(self) -> None:
        try:
            outcome: T | Exception = self._work()
        except Exception as error:  # noqa: BLE001 - whatever it is, the loop gets it
            outcome = error
        self._outcomes.append(outcome)
        # Kept first and asked afterwards, and `abandon` the other way round: so exactly one of the two takes it out.
        if self._is_abandoned:
            self._discard_outcome()

    def _discard_outcome(self) -> None:
        outcome = self.take_outcome()
        if outcome is not None and not isinstance(outcome, Exception):
            self._discard(outcome)


class Recovery(Generic[T]):
    """What a link does when its port is lost: it keeps why, closes it off the loop, and opens it again.

    The reason is why the port was lost, empty while none is; the failure, why the last attempt to open it again failed,
    empty before one has, and when one has not.
    """

    def __init__(
        self, name: str, open_port: Callable[[], T], close_port: Callable[[T], None], now_ns: NowNs, remedy: str = ""
    ) -> None:
        """Recover with `open_port`, which may take its time and must touch nothing that the loop uses.

        `close_port` closes one that was opened and is no longer wanted; `remedy` is what a person can do about a loss.
        """
        self.reason = ""
        self.failure = ""
        self._name = name
        self._remedy = remedy
        self._open_port = open_port
        self._lost: deque[Callable[[], None]] = deque()
        self._close_port = close_port
        self._now_ns = now_ns
        self._began_ns: int | None = None
        self._attempt: BackgroundTask[T] | None = None

    def open(self) -> T:
        """Close what was lost, and open the port."""
        self._close_lost()
        return self._open_port()

    def lose(self, close: Callable[[], None], reason: str) -> None:
        """A port was lost; `close` closes it, which may take its time."""
        self._lost.append(close)
        self.reason = reason

    def lost(self) -> LinkLostError:
        """The error with why the port was lost, and what to do."""
        remedy = f"; {self._remedy}" if self._remedy else ""
        return LinkLostError(f"{self._name} is gone: {self.reason}{remedy}")

    def regain(self) -> T:
        """The port, once it is open again; tried one attempt at a time, and no faster than `RETRY_NS`.

        Raises:
            LinkLostError: It is not yet, or it was closed and not lost.
        """
        if not self.reason:
            raise LinkLostError(f"{self._name} is not open")
        outcome: T | Exception | None = None
        if self._attempt is not None:
            outcome = self._attempt.take_outcome()
            self._attempt = self._attempt if outcome is None else None
        elif self._began_ns is None or self._now_ns() - self._began_ns >= RETRY_NS:
            self._began_ns = self._now_ns()
            self._attempt = BackgroundTask(self.open, self._close_port)
        if isinstance(outcome, Exception):
            self.failure = str(outcome)
        if outcome is None or isinstance(outcome, Exception):
            raise self.lost()
        self.reason = self.failure = ""
        return outcome

    def end(self) -> None:
        """Want no port any more: close what was lost, and whatever is on its way to be opened."""
        if self._attempt is not None:
            self._attempt.abandon()
            self._attempt = None
        self._close_lost()
        self.reason = self.failure = ""

    def _close_lost(self) -> None:
        # Each is closed by whoever takes it out: the thread that opens again, or `end`.
        while True:
            try:
                close = self._lost.popleft()
            except IndexError:
                return
            close()
