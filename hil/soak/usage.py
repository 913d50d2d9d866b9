# SPDX-License-Identifier: MIT
"""What a process takes of the machine, read from outside it in /proc (proc(5))."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

_PROC: Final = Path("/proc")
_OWN_MEMORY: Final = ("RssAnon", "RssShmem", "VmSwap")
"""What a process takes for itself. Pages of files are not counted: those of its libraries come and go with the need of
others, and are given back whenever the kernel wants them."""


class Usage(NamedTuple):
    """What a process takes.

    Attributes:
        memory_kb: Memory of its own, swapped out or not, kB.
        pss_kb: Its share of all memory that it uses, that of libraries included, kB (proportional set size).
        files: Open descriptors.
        threads: Threads.
    """

    memory_kb: float
    pss_kb: float
    files: int
    threads: int


def usage(process: int) -> Usage | None:
    """What a process takes; None where it has ended."""
    try:  # one that has ended, and of which its parent has not yet asked how, fails in the second line
        status = _fields(_PROC / str(process) / "status")
        shares = _fields(_PROC / str(process) / "smaps_rollup")
        files = len(os.listdir(_PROC / str(process) / "fd"))  # noqa: PTH208 - names are all that is wanted
    except OSError:
        return None
    memory_kb = sum(status[name] for name in _OWN_MEMORY)
    return Usage(memory_kb, shares.get("Pss", 0.0), files, round(status["Threads"]))


def children(process: int) -> Iterator[tuple[int, str]]:
    """The processes that a process started and that still run, each with its command line."""
    for task in sorted((_PROC / str(process) / "task").glob("*")):
        with contextlib.suppress(OSError):
            for word in (task / "children").read_text(encoding="ascii").split():
                command = (_PROC / word / "cmdline").read_bytes().replace(b"\0", b" ")
                yield int(word), command.decode(errors="replace").strip()


def _fields(path: Path) -> dict[str, float]:
    """The lines `Name: number ...` of a file; others are left out."""
    fields = {}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        name, _, rest = line.partition(":")
        words = rest.split()
        if words and words[0].isdigit():
            fields[name] = float(words[0])
    return fields
