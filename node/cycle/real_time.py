# SPDX-License-Identifier: MIT
"""The loop's real-time requirements of the kernel and of Python."""

import contextlib
import ctypes
import os
import resource
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

PRIORITY: Final = 50
"""Of SCHED_FIFO, 1 to 99: above ordinary programs, at the level of interrupt threads on a real-time kernel."""
HELPERS_PRIORITY: Final = PRIORITY - 5
"""Of the threads and processes that publish for the loop: above other programs, below the loop."""
SWITCH_INTERVAL_S: Final = 0.0005
"""After this long, another thread of this process hands Python over to the loop."""

_PR_SET_TIMERSLACK: Final = 29
_PR_GET_TIMERSLACK: Final = 30
"""Of linux/prctl.h; the slack is by how much the kernel may be late on purpose, 50 us by default."""
_LOCK_CURRENT: Final = 1
_LOCK_FUTURE: Final = 2
_LOCK_ON_FAULT: Final = 4
"""Flags of mlockall(2) (linux/mman.h); the last locks what is used, instead of all that is reserved."""
IDLE_LATENCY: Final = Path("/dev/cpu_dma_latency")
"""Kept open, it holds the processors out of idle states that take longer to leave than what was written to it, us."""
ISOLATED: Final = Path("/sys/devices/system/cpu/isolated")
"""The processors on which nothing runs that was not put there (`isolcpus` on the kernel's command line)."""


def is_real_time() -> bool:
    """Whether the calling thread is scheduled in real time."""
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK in (os.SCHED_FIFO, os.SCHED_RR)


@contextlib.contextmanager
def real_time_loop(*, lock: bool = True) -> Iterator[tuple[str, ...]]:
    """Meet the real-time requirements of the calling thread, as far as they can be, while the context lasts.

    Each is checked after it was requested. At the end all is given back but the locked memory.

    Args:
        lock: Whether the process' memory is to be locked.

    Yields:
        What was not to be had, each with its effect and how to get it.
    """
    with contextlib.ExitStack() as stack:
        lacking = [
            stack.enter_context(real_time_priority()),
            stack.enter_context(no_deep_idle()),
            _use_isolated(stack),
            _end_timer_slack(stack),
            lock_memory() if lock else None,
        ]
        before_s = sys.getswitchinterval()
        sys.setswitchinterval(min(before_s, SWITCH_INTERVAL_S))
        stack.callback(sys.setswitchinterval, before_s)
        yield tuple(text for text in lacking if text is not None)


@contextlib.contextmanager
def real_time_priority(priority: int = PRIORITY) -> Iterator[str | None]:
    """Real-time scheduling of the calling thread while the context lasts, where it is to be had; it keeps what it has.

    Threads and processes that it starts do not inherit it, and it is given back at the end: what a program does after
    its loop, and its exit, must not preempt the loops of others.

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


@contextlib.contextmanager
def helping_threads() -> Iterator[None]:
    """The threads that begin inside help the loop: a real-time priority below its own, where it is to be had."""
    before = set(Path("/proc/self/task").iterdir())
    yield
    for thread in set(Path("/proc/self/task").iterdir()) - before:
        with contextlib.suppress(OSError):  # it has ended, or we may not, which is reported of the loop itself
            os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(HELPERS_PRIORITY))


def lock_memory() -> str | None:
    """Keep what this process uses in RAM from now on: a page that has to come from the disk takes longer than a cycle.

    With a limit nothing is locked: whoever reached it later could get no more memory at all.

    Returns:
        None where it is locked, else why not and what that means.
    """
    unlimited = resource.RLIM_INFINITY
    with contextlib.suppress(OSError, ValueError):  # only the privileged may lift the limit
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (unlimited, unlimited))
    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] != unlimited:
        reason = "its amount is limited"
    elif ctypes.CDLL(None, use_errno=True).mlockall(_LOCK_CURRENT | _LOCK_FUTURE | _LOCK_ON_FAULT) != 0:
        reason = os.strerror(ctypes.get_errno())
    else:
        return None
    return f"memory is not locked ({reason}): where it runs short, cycles wait for the disk; ulimit -l unlimited"


@contextlib.contextmanager
def no_deep_idle() -> Iterator[str | None]:
    """Keep processors out of deep idle states, which take long to leave, and leave caches empty.

    Yields:
        None while that is held, else why not and what that means.
    """
    try:
        held = os.fdopen(os.open(IDLE_LATENCY, os.O_WRONLY | os.O_CLOEXEC), "wb", buffering=0)
    except OSError as error:
        yield (
            f"processors may sleep deeply between cycles ({IDLE_LATENCY}: {error.strerror}): each begins slowly; "
            "run as root, or let the robot's group write to that file"
        )
        return
    with held:
        held.write(struct.pack("i", 0))
        yield None


def _use_isolated(stack: contextlib.ExitStack) -> str | None:
    before, aside = os.sched_getaffinity(0), isolated_processors()
    if not aside or before <= aside:
        return None
    try:
        os.sched_setaffinity(0, aside)
    except OSError as error:
        return f"not on the isolated processors {sorted(aside)} ({error.strerror}): other programs can make cycles late"
    stack.callback(os.sched_setaffinity, 0, before)
    return None


def isolated_processors() -> set[int]:
    """The processors that were set aside when the kernel was started."""
    try:
        text = ISOLATED.read_text().strip()
    except OSError:
        return set()
    ends = [part.split("-") for part in text.split(",") if part]
    return {number for end in ends for number in range(int(end[0]), int(end[-1]) + 1)}


def _end_timer_slack(stack: contextlib.ExitStack) -> str | None:
    prctl = ctypes.CDLL(None, use_errno=True).prctl
    before_ns = prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0)
    prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1), 0, 0, 0)
    slack_ns = prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0)
    stack.callback(prctl, _PR_SET_TIMERSLACK, ctypes.c_ulong(max(before_ns, 1)), 0, 0, 0)
    if is_real_time() or slack_ns == 1:  # with real-time scheduling a thread wakes at its time anyway
        return None
    return f"the kernel wakes this thread up to {slack_ns * 1e-3:.0f} us late on purpose (timer slack)"
