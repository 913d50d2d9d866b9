# SPDX-License-Identifier: MIT
"""A machine that stands still, as a virtual one does for its neighbours, decides a test in real time.

Witnesses know of it: a process on each processor that wakes every 2 ms and looks for gaps longer than what a robot may
go without word from its drives. Where real-time priority is allowed they are above everything else of this machine, and
a test that failed during a gap is run again, once. Where it is not they are as any other program, as the robots are:
a test that failed in a module in which there was a gap has shown nothing, and is reported as skipped, with the gap.
What was run again or not shown, and why, ends the summary.
"""

import contextlib
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

import pytest
from _pytest.runner import runtestprotocol

HELD_UP_S: Final = 0.01
"""A gap that counts; at 200 Hz, a robot trips when it has heard nothing for 15 ms."""
PROPERTY: Final = "run again: the machine stood still, ms"
NOT_SHOWN: Final = "not shown: without real-time priority the machine stood still, ms"
_WAKES_EVERY_S: Final = 0.002
_HIGHEST: Final = 99


class Witnesses:
    """One on each processor; they end with this process.

    Attributes:
        are_above: Whether they have real-time priority.
    """

    def __init__(self) -> None:
        self.are_above = _may_be_above()
        self._processes = [
            subprocess.Popen(
                [sys.executable, "-P", "-m", "segway_ecc.hil.child", str(os.getpid()), __name__, str(core)],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
            for core in sorted(os.sched_getaffinity(0))
        ]
        for process in self._processes:
            assert process.stdout is not None
            process.stdout.readline()  # it has begun
            os.set_blocking(process.stdout.fileno(), False)

    def longest_gap_s(self) -> float:
        """The longest gap that counts since the last call, s; 0 where there was none."""
        heard = b"".join(process.stdout.read() or b"" for process in self._processes if process.stdout is not None)
        return max(map(float, heard.split()), default=0.0)

    def close(self) -> None:
        for process in self._processes:
            process.kill()
            process.communicate()


WITNESSES: Final = pytest.StashKey[Witnesses]()
MODULE: Final = pytest.StashKey[tuple[Path, float]]()
"""The module of the newest test, and the longest gap in it so far, s."""


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    if item.get_closest_marker("real_time") is None:
        return None
    witnesses = _witnesses(item.config)
    witnesses.longest_gap_s()
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    reports = runtestprotocol(item, log=False, nextitem=nextitem)
    failed = [report for report in reports if report.failed]
    gap_s = witnesses.longest_gap_s()
    path, before_s = item.config.stash.get(MODULE, (item.path, 0.0))
    in_module_s = max(gap_s, before_s if path == item.path else 0.0)
    item.config.stash[MODULE] = item.path, in_module_s
    if failed and gap_s > 0.0 and witnesses.are_above:
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        reports[0].user_properties.append((PROPERTY, round(gap_s * 1e3)))
        reports[0].sections.append(("The run in which the machine stood still", failed[0].longreprtext))
    elif in_module_s > 0.0 and not witnesses.are_above:
        for report in failed:
            report.outcome = "skipped"
            report.longrepr = str(item.path), item.location[1] or 0, NOT_SHOWN
            report.user_properties.append((NOT_SHOWN, round(in_module_s * 1e3)))
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    reports = [report for reports in terminalreporter.stats.values() for report in reports]
    for report in reports:
        for name, value in getattr(report, "user_properties", ()):
            if name in {PROPERTY, NOT_SHOWN}:
                terminalreporter.write_line(f"{report.nodeid}: {name}: {value}", yellow=True)


def _may_be_above() -> bool:
    if os.geteuid() == 0:
        return True
    return resource.getrlimit(resource.RLIMIT_RTPRIO)[0] >= _HIGHEST


def _witnesses(config: pytest.Config) -> Witnesses:
    if WITNESSES not in config.stash:
        config.stash[WITNESSES] = witnesses = Witnesses()
        config.add_cleanup(witnesses.close)
    return config.stash[WITNESSES]


def _bear_witness(core: int) -> None:
    os.sched_setaffinity(0, {core})
    if _may_be_above():
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_HIGHEST))
    print("begun", flush=True)  # noqa: T201 - to who started it
    while True:
        before_s = time.monotonic()
        time.sleep(_WAKES_EVERY_S)
        gap_s = time.monotonic() - before_s
        if gap_s > HELD_UP_S:
            sys.stdout.write(f"{gap_s}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        _bear_witness(int(sys.argv[1]))
