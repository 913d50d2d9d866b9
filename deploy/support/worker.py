"""One job at a time, in the background and at the lowest priority, so that nothing else on the machine feels it."""

import contextlib
import os
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Final

_LOWEST: Final = 19
_ENDS_WITHIN_S: Final = 10.0
_KEPT: Final = 256


class Worker:
    """Does jobs, each known by a key; asked again, it tells what came of it. Used by one thread.

    Attributes:
        key: Of the job that is being done, or was last.
    """

    def __init__(self) -> None:
        """Begin with nothing done."""
        self.key = ""
        self._results: OrderedDict[str, str] = OrderedDict()
        self._thread: threading.Thread | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a job is being done."""
        return self._thread is not None and self._thread.is_alive()

    def result(self, key: str) -> str | None:
        """What came of a job; None where there is nothing yet."""
        return self._results.get(key)

    def forget(self, key: str) -> None:
        """Let a job be done again."""
        self._results.pop(key, None)

    def begin(self, key: str, job: Callable[[], str]) -> bool:
        """Do a job, in place of what came of it before; whether it was begun, which it is not while another is done."""
        if self.is_busy:
            return False
        self.forget(key)
        self.key = key
        self._thread = threading.Thread(target=self._run, args=(key, job), name="archive", daemon=True)
        self._thread.start()
        return True

    def close(self) -> None:
        """Wait a moment for what is being done."""
        if self._thread is not None:
            self._thread.join(_ENDS_WITHIN_S)

    def _run(self, key: str, job: Callable[[], str]) -> None:
        with contextlib.suppress(OSError):
            # On Linux a priority is of one thread (setpriority(2), NOTES).
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LOWEST)
        try:
            result = job()
        except Exception as error:  # noqa: BLE001 - whoever asked is told
            result = f"failed: {getattr(error, 'strerror', None) or error or type(error).__name__}"
        self._results[key] = result
        while len(self._results) > _KEPT:
            self._results.popitem(last=False)
