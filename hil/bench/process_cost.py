# SPDX-License-Identifier: MIT
"""What a process and its children take of the machine, from /proc (proc(5))."""

import contextlib
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_PROC: Final = Path("/proc")
_TICK_S: Final = 1.0 / os.sysconf("SC_CLK_TCK")
_KB: Final = 1024
_PARENT, _USER, _SYSTEM = 1, 11, 12
"""Places in /proc/PID/stat after the name."""


@dataclass(frozen=True, slots=True)
class Memory:
    """Of a process and its children, bytes.

    Attributes:
        rss: Resident; what two of them share counts twice.
        pss: Resident, with what is shared by n processes counted as an n-th.
    """

    rss: int
    pss: int


def tree(pid: int, proc: Path = _PROC) -> list[int]:
    """A process and all that descend from it, itself first."""
    parents = {int(e.name): int(fields[_PARENT]) for e in proc.glob("[0-9]*") if (fields := _stat(e))}
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
    totals = {"Rss": 0, "Pss": 0}
    for pid in pids:
        with contextlib.suppress(OSError):
            text = (proc / str(pid) / "smaps_rollup").read_text(encoding="ascii")
            for name, kilobytes in re.findall(r"^(Rss|Pss): +(\d+) kB$", text, re.MULTILINE):
                totals[name] += int(kilobytes) * _KB
    return Memory(totals["Rss"], totals["Pss"])


def _stat(folder: Path) -> list[str]:
    """What follows the name, which may hold spaces and brackets."""
    return _read(folder / "stat").rpartition(")")[2].split()


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:  # it has ended meanwhile
        return ""
