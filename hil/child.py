# SPDX-License-Identifier: MIT
"""A module in a process that does not outlive its parent: arguments PARENT MODULE [ARGUMENT ...].

Not even a parent that is killed, which can end nothing any more.
"""

import ctypes
import os
import runpy
import signal
import sys
from typing import Final

_PR_SET_PDEATHSIG: Final = 1
"""From linux/prctl.h."""


def end_with(parent: int) -> None:
    """Be killed when the thread that started this process ends; `parent` is that thread's process.

    Killed, and not asked to end: a process that is stopped (SIGSTOP) handles no other signal.

    Raises:
        OSError: The kernel does not do it.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL)) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
    if os.getppid() != parent:  # it ended before we asked
        os.kill(os.getpid(), signal.SIGKILL)


if __name__ == "__main__":
    _, first, name, *rest = sys.argv
    end_with(int(first))
    sys.argv = [name, *rest]
    runpy.run_module(name, run_name="__main__", alter_sys=True)
