# SPDX-License-Identifier: MIT
"""One task at a time, in the background and at the lowest priority, so that nothing else on the machine is slowed."""

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
    """Runs tasks, each known by a key, and keeps their results. Used by one thread.

    Attributes:
        key: Of the task that runs, or ran last.
    """

    def __init__(self) -> None:
        """Begin with nothing done."""
        self.key = ""
        self._results: OrderedDict[str, str] = OrderedDict()
        self._thread: threading.Thread | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a task runs."""
        return self._thread is not None and self._thread.is_alive()

    def result(self, key: str) -> str | None:
        """The result of a task; None where there is none yet."""
        return self._results.get(key)

    def forget(self, key: str) -> None:
        """Discard a result, so that its task can run again."""
        self._results.pop(key, None)

    def begin(self, key: str, task: Callable[[], str]) -> bool:
        """Run a task in place of its last result; whether it was begun, which it is not while another runs."""
        if self.is_busy:
            return False
        self.forget(key)
        self.key = key

        def run() -> None:
            with contextlib.suppress(OSError):
                # On Linux a priority is of one thread (setpriority(2), NOTES).
                os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LOWEST)
            try:
                result = task()
            except Exception as error:  # noqa: BLE001 - whoever asks gets it as the result
                result = f"failed: {getattr(error, 'strerror', None) or error or type(error).__name__}"
            self._results[key] = result
            while len(self._results) > _KEPT:
                self._results.popitem(last=False)

        self._thread = threading.Thread(target=run, name="archive", daemon=True)
        self._thread.start()
        return True

    def close(self) -> None:
        """Wait a moment for the task that runs."""
        if self._thread is not None:
            self._thread.join(_ENDS_WITHIN_S)
