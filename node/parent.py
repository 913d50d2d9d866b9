# SPDX-License-Identifier: MIT
"""What a process of ours asks of the kernel about the end of its parent, even one that is killed and ends nothing."""

import ctypes
import os
import signal
from typing import Final

_PR_SET_PDEATHSIG: Final = 1
"""Of linux/prctl.h: the signal that a process receives when the thread that started it ends."""


def signal_at_its_end(number: signal.Signals) -> None:
    """Have this process receive a signal when the thread that started it ends.

    Raises:
        OSError: The kernel does not do it.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(number)) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")


def end_with(parent: int) -> None:
    """Be killed when the thread that started this process ends; `parent` is that thread's process.

    Killed, and not asked to end: a process that is stopped (SIGSTOP) handles no other signal.

    Raises:
        OSError: The kernel does not do it.
    """
    signal_at_its_end(signal.SIGKILL)
    if os.getppid() != parent:  # it ended before we asked
        os.kill(os.getpid(), signal.SIGKILL)
