# SPDX-License-Identifier: MIT
"""What processes take of the machine, read from outside them in /proc (proc(5))."""

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

_PROC: Final = Path("/proc")
_TICK_S: Final = 1.0 / os.sysconf("SC_CLK_TCK")
_KB: Final = 1024
_PARENT, _USER, _SYSTEM = 1, 11, 12
"""Places in /proc/PID/stat after the name."""
_OWN_MEMORY: Final = ("RssAnon", "RssShmem", "VmSwap")
"""What a process takes for itself. Pages of files are not counted: those of its libraries come and go with the need of
others, and are given back whenever the kernel wants them."""
_HELPERS: Final = {
    "recorder": "segway_ecc.node.recording.writer",
    "ros": "segway_ecc.node.ros.process",
    "watchdog": "segway_ecc.node.watchdog.process",
}
"""What is found in the command lines of the processes that a node starts, by what they are."""


@dataclass(frozen=True, slots=True)
class Memory:
    """Of a process and its children, bytes: `rss` is resident, what two of them share counts twice.

    `pss` is resident too, with what is shared by n processes counted as an n-th.
    """

    rss: int
    pss: int


class Usage(NamedTuple):
    """What a process takes.

    Attributes:
        memory_kb: Memory of its own, swapped out or not, kB.
        pss_kb: Its share of all memory that it uses, that of libraries included, kB (proportional set size).
        files: Open descriptors.
    """

    memory_kb: float
    pss_kb: float
    files: int
    threads: int


def usage(process: int) -> Usage | None:
    """What a process takes; None where it has ended."""
    folder = _PROC / str(process)
    try:  # one that has ended, and of which its parent has not yet asked how, fails in the second line
        status, shares = _fields(folder / "status"), _fields(folder / "smaps_rollup")
        files = len(os.listdir(folder / "fd"))  # noqa: PTH208 - names are all that is wanted
    except OSError:
        return None
    memory_kb = sum(status[name] for name in _OWN_MEMORY)
    return Usage(memory_kb, shares.get("Pss", 0), files, status["Threads"])


def helpers_of(process: int) -> dict[str, int]:
    """The processes that a node has started and that still run, by what they are: `recorder`, `ros` and `watchdog`."""
    started = (pid for pid, parent in _parents(_PROC).items() if parent == process)
    words = {pid: _read(_PROC / str(pid) / "cmdline") for pid in started}
    return {name: pid for name, word in _HELPERS.items() for pid, line in words.items() if word in line}


def tree(pid: int, proc: Path = _PROC) -> list[int]:
    """A process and all that descend from it, itself first."""
    parents = _parents(proc)
    found = [pid]
    for process in found:  # grows as it goes
        found += sorted(child for child, parent in parents.items() if parent == process)
    return found


def cpu_s(pids: list[int], proc: Path = _PROC) -> float:
    """The CPU time that processes have used, s; by the scheduler's own count where the kernel keeps one."""
    total_s = 0.0
    for folder in (proc / str(pid) for pid in pids):
        counted = [counts for task in folder.glob("task/*/schedstat") if (counts := _read(task).split())]
        if counted:
            total_s += sum(int(counts[0]) for counts in counted) * 1e-9
        elif fields := _stat(folder):
            total_s += (int(fields[_USER]) + int(fields[_SYSTEM])) * _TICK_S
    return total_s


def memory(pids: list[int], proc: Path = _PROC) -> Memory:
    """The memory that processes hold; one that has ended holds none."""
    rss = pss = 0
    for pid in pids:
        with contextlib.suppress(OSError):
            fields = _fields(proc / str(pid) / "smaps_rollup")
            rss, pss = rss + fields.get("Rss", 0) * _KB, pss + fields.get("Pss", 0) * _KB
    return Memory(rss, pss)


def _parents(proc: Path) -> dict[int, int]:
    return {int(e.name): int(fields[_PARENT]) for e in sorted(proc.glob("[0-9]*")) if (fields := _stat(e))}


def _fields(path: Path) -> dict[str, int]:
    """The lines `Name: number ...` of a file; others are left out."""
    lines = (line.partition(":") for line in path.read_text(encoding="utf-8", errors="replace").splitlines())
    words = {name: rest.split() for name, _, rest in lines}
    return {name: int(values[0]) for name, values in words.items() if values and values[0].isdigit()}


def _stat(folder: Path) -> list[str]:
    """What follows the name, which may hold spaces and brackets."""
    return _read(folder / "stat").rpartition(")")[2].split()


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:  # it has ended meanwhile
        return ""
