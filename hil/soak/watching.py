# SPDX-License-Identifier: MIT
"""Watches processes while they run, and keeps what they take as series."""

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from segway_ecc.hil.soak.judging import Series
from segway_ecc.hil.soak.usage import children, usage
from segway_ecc.node.recording.log_quota import MB, LogQuota

ALLOWED_KB: Final = 512.0
"""Growth of a process' memory that is none: allocators take from the kernel up to a megabyte at a time. In half an hour
at 200 Hz a byte and a half per cycle is more than that, in four hours a fifth of a byte."""
LOG: Final = LogQuota(total_bytes=32 * MB, file_bytes=8 * MB)
"""Room for the log of a soak: small, so that files are begun, finished and removed all the time."""
_HELPERS: Final = {"recorder": "segway_ecc.node.recording.writer", "ros": "segway_ecc.node.ros.process"}
"""What is found in the command lines of the processes that a node starts, by what they are."""
_NONE: Final = 0.5
"""Of what is counted in whole numbers, one more is growth."""


class Counted(NamedTuple):
    """What a process counts of itself and reports, with how much it may grow; None where that is not judged."""

    quantity: str
    allowed: float | None


class Watching:
    """Series of processes and of the folder of a log.

    Attributes:
        series: What was seen, in the order in which it was seen first.
    """

    def __init__(self, folder: Path) -> None:
        """Watch; the log is in `folder`."""
        self.series: list[Series] = []
        self._folder = folder
        self._found: dict[tuple[str, str], Series] = {}

    def look(self, time_s: float, processes: Mapping[str, int]) -> None:
        """Take a sample of each process that runs, by what it is, and of the log."""
        for name, process in processes.items():
            taken = usage(process)
            if taken is None:
                continue
            self._add(name, "memory", time_s, taken.memory_kb, unit="kB", allowed=ALLOWED_KB)
            self._add(name, "proportional set size", time_s, taken.pss_kb, unit="kB", allowed=None)
            self._add(name, "open files", time_s, taken.files)
            self._add(name, "threads", time_s, taken.threads)
        sizes = []
        for path in self._folder.glob("*.mcap"):
            with contextlib.suppress(OSError):  # it was removed just now
                sizes.append(path.stat().st_size)
        room = LOG.total_bytes + LOG.file_bytes
        self._add("log", "room", time_s, sum(sizes) / MB, unit="MB", most=room / MB)
        self._add("log", "files", time_s, len(sizes), most=room // LOG.file_bytes + 1)

    def count(self, time_s: float, process: str, counted: Counted, value: float) -> None:
        """Take what a process counts of itself."""
        self._add(process, counted.quantity, time_s, value, allowed=counted.allowed)

    def _add(  # noqa: PLR0913 - what a series is made of
        self,
        process: str,
        quantity: str,
        time_s: float,
        value: float,
        *,
        unit: str = "",
        allowed: float | None = _NONE,
        most: float | None = None,
    ) -> None:
        key = process, quantity
        if key not in self._found:
            made = Series(process=process, quantity=quantity, unit=unit, allowed=allowed, most=most)
            self._found[key] = made
            self.series.append(made)
        self._found[key].times_s.append(time_s)
        self._found[key].values.append(value)


def helpers_of(process: int) -> dict[str, int]:
    """The processes that a node has started, by what they are: `recorder` and `ros`."""
    started = list(children(process))
    return {name: child for name, word in _HELPERS.items() for child, words in started if word in words}
