# SPDX-License-Identifier: MIT
"""What this process does for itself once its model's watchdog has ended, as where somebody killed that.

It answers who asks before an end with status 0. So a model's is none, as before, and the process and its helpers end as
they should; left unanswered they would wait for ever. That a call returns in time is watched no more: the loop, which
feeds the watchdog of systemd, the guard and the drives notice that.
"""

import logging
import os
import signal
import subprocess
import threading
from pathlib import Path
from typing import Final

from segway_ecc.node.helper import write_message
from segway_ecc.node.watchdog.exits import Exits

_LOOKS_EVERY_S: Final = 0.2
_logger = logging.getLogger(__name__)


class StandIn:
    """Waits until the watchdog ends, and stands in for it where that was not to be.

    Attributes:
        name: What is watched, as it is called in messages.
    """

    def __init__(self, process: "subprocess.Popen[bytes]", exits: Exits | None, name: str) -> None:
        """Wait for `process`; `exits` is where it is asked, None where the kernel does not ask."""
        self.name = name
        self._process, self._exits = process, exits
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._wait, daemon=True)
        self._thread.start()

    def end(self) -> None:
        """The process is to end as it should, and its watchdog has ended, well or not."""
        self._is_over.set()
        self._thread.join()
        if self._exits is None:
            return
        if self._process.returncode:
            self._exits.answer_until_this_ends()
        self._exits.close()

    def _wait(self) -> None:
        if not self._process.wait():
            return
        _logger.warning(
            "the watchdog of the model has ended (status %d): a model that does not return is not ended any more",
            self._process.returncode,
        )
        exits = self._exits
        while exits is not None and not self._is_over.is_set():
            if exits.is_asked(_LOOKS_EVERY_S) and not exits.answer(_is_of_another):
                write_message(f"model '{self.name}' ended the process with status 0, as by _exit, with no watchdog")
                os.kill(os.getpid(), signal.SIGABRT)


def _is_of_another(thread: int) -> bool:
    """Whether a thread is none of this process, but of one that it has started."""
    return not Path(f"/proc/self/task/{thread}").exists()
