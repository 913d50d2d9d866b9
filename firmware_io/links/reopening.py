"""Work that may take its time, done off the loop."""

import _thread
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

from segway_ecc.firmware_io.errors import LinkLostError

T = TypeVar("T")
NowNs = Callable[[], int]

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

    def take(self) -> T | Exception | None:
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
        outcome = self.take()
        if outcome is not None and not isinstance(outcome, Exception):
            self._discard(outcome)


class Reopening(Generic[T]):
    """Tries again and again to open something, one attempt at a time and no faster than `RETRY_NS`.

    Attributes:
        failure: Why the last attempt failed; empty before one has, and when one has not.
    """

    def __init__(self, open_again: Callable[[], T], close: Callable[[T], None], now_ns: NowNs) -> None:
        """Describe it; `poll` drives it. `close` is for what is opened when it is no longer wanted."""
        self.failure = ""
        self._open_again = open_again
        self._close = close
        self._now_ns = now_ns
        self._began_ns: int | None = None
        self._attempt: BackgroundTask[T] | None = None

    def poll(self) -> T | None:
        """What has been opened, once; otherwise None, and an attempt is begun where one is due."""
        if self._attempt is None:
            self._begin_if_due()
            return None
        outcome = self._attempt.take()
        if outcome is None:
            return None
        self._attempt = None
        if isinstance(outcome, Exception):
            self.failure = str(outcome)
            return None
        self.failure = ""
        return outcome

    def cancel(self) -> None:
        """End it: what an attempt still opens is closed at once."""
        self.failure = ""
        if self._attempt is not None:
            self._attempt.abandon()
            self._attempt = None

    def _begin_if_due(self) -> None:
        now_ns = self._now_ns()
        if self._began_ns is None or now_ns - self._began_ns >= RETRY_NS:
            self._began_ns = now_ns
            self._attempt = BackgroundTask(self._open_again, self._close)


class Recovery(Generic[T]):
    """What a link does when its port is lost: it keeps why, closes it off the loop, and opens it again.

    Attributes:
        reason: Why the port was lost; empty while none is.
    """

    def __init__(
        self, name: str, open_port: Callable[[], T], close_port: Callable[[T], None], now_ns: NowNs, cure: str = ""
    ) -> None:
        """Recover with `open_port`, which may take its time and must touch nothing that the loop uses.

        Args:
            name: Whose port it is, for people.
            open_port: Opens it.
            close_port: Closes one that was opened and is no longer wanted.
            now_ns: The clock of the loop.
            cure: What a person can do where it is lost.
        """
        self.reason = ""
        self._name = name
        self._cure = cure
        self._open_port = open_port
        self._lost: deque[Callable[[], None]] = deque()
        self._reopening = Reopening(self.open, close_port, now_ns)

    @property
    def failure(self) -> str:
        """Why the last attempt to open it failed; empty where none has."""
        return self._reopening.failure

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
        cure = f"; {self._cure}" if self._cure else ""
        return LinkLostError(f"{self._name} is gone: {self.reason}{cure}")

    def regain(self) -> T:
        """The port, once it is open again.

        Raises:
            LinkLostError: It is not yet, or it was closed and not lost.
        """
        if not self.reason:
            raise LinkLostError(f"{self._name} is not open")
        opened = self._reopening.poll()
        if opened is None:
            raise self.lost()
        self.reason = ""
        return opened

    def end(self) -> None:
        """Want no port any more: close what was lost, and whatever is on its way to be opened."""
        self._reopening.cancel()
        self._close_lost()
        self.reason = ""

    def _close_lost(self) -> None:
        # Each is closed by whoever takes it out: the thread that opens again, or `end`.
        while True:
            try:
                close = self._lost.popleft()
            except IndexError:
                return
            close()
