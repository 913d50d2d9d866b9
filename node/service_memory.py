"""Keeps a service's memory in RAM: a page that has to come from the disk takes longer than a cycle."""

import ctypes
import resource
from typing import Final

_CURRENT: Final = 1
_FUTURE: Final = 2
_ON_FAULT: Final = 4
"""Flags of mlockall(2) (linux/mman.h); the last locks what is used, instead of all that is reserved."""


def lock_memory() -> bool:
    """Lock what this process uses from now on; False where it may not without limit, or the kernel refuses.

    With a limit nothing is locked: whoever reached it later could get no more memory at all.
    """
    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] != resource.RLIM_INFINITY:
        return False
    return bool(ctypes.CDLL(None, use_errno=True).mlockall(_CURRENT | _FUTURE | _ON_FAULT) == 0)
