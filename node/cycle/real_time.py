"""What this process asks of the kernel, so that its loop is not kept waiting by other programs."""

import contextlib
import os
from collections.abc import Iterator
from typing import Final

PRIORITY: Final = 50
"""Of SCHED_FIFO, 1 to 99: above ordinary programs, at the level of interrupt threads on a real-time kernel."""


def is_real_time() -> bool:
    """Whether the calling thread is scheduled in real time."""
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK in (os.SCHED_FIFO, os.SCHED_RR)


@contextlib.contextmanager
def real_time_priority(priority: int = PRIORITY) -> Iterator[str | None]:
    """Real-time scheduling of the calling thread while the context lasts, where it is to be had; it keeps what it has.

    Threads and processes that it starts do not inherit it, and it is given back at the end: what a program does after
    its loop, and its exit, must not hold up the loops of others.

    Args:
        priority: Of SCHED_FIFO (sched(7)), 1 to 99.

    Yields:
        None where it was granted, else why not and what that means.
    """
    if is_real_time():  # a service has the priority that its unit gave it
        yield None
        return
    # The flag stays set: only the privileged may clear it.
    before = os.sched_getscheduler(0) | os.SCHED_RESET_ON_FORK, os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        yield (
            f"no real-time priority ({error.strerror}): other programs can make cycles late; "
            "run as root, or raise the limit: ulimit -r"
        )
        return
    try:
        yield None
    finally:
        os.sched_setscheduler(0, *before)
