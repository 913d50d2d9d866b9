"""What this process asks of the kernel, so that its loop is not kept waiting by other programs."""

import os
from typing import Final

PRIORITY: Final = 50
"""Of SCHED_FIFO, 1 to 99: above ordinary programs, at the level of interrupt threads on a real-time kernel."""


def request_real_time(priority: int = PRIORITY) -> str | None:
    """Ask for real-time scheduling of the calling thread; threads and processes it starts later do not inherit it.

    Args:
        priority: Of SCHED_FIFO (sched(7)), 1 to 99.

    Returns:
        None where it was granted, else why not and what that means.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        return (
            f"no real-time priority ({error.strerror}): other programs can make cycles late; "
            "run as root, or raise the limit: ulimit -r"
        )
    return None
