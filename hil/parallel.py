# SPDX-License-Identifier: MIT
"""Simulated runs in processes side by side, and without the node's messages."""

import contextlib
import logging
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.context import SpawnContext
from typing import TypeVar

from segway_ecc.hil.processes import inherited

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


@contextlib.contextmanager
def results_of(
    run: Callable[[_Task], _Result], tasks: Sequence[_Task], jobs: int, chunk: int = 1
) -> Iterator[Iterator[_Result]]:
    """The result of each task, in their order.

    Args:
        run: Runs one task; a function of a module, so that another process finds it.
        tasks: What to run.
        jobs: How many processes run at a time; 1 for this one alone.
        chunk: Tasks that are handed to a process at a time.
    """
    if jobs == 1:
        yield map(run, tasks)
        return
    with spawning() as processes, processes.Pool(jobs, ignore_interrupt) as pool:
        yield pool.imap(run, tasks, chunk)


def ignore_interrupt() -> None:
    """Leave Ctrl-C to the parent process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextlib.contextmanager
def quiet(*loggers: str) -> Iterator[None]:
    """Discard the messages of some loggers, which are many in a run with faults."""
    levels = {logger: logger.level for logger in map(logging.getLogger, loggers)}
    try:
        for logger in levels:
            logger.setLevel(logging.CRITICAL)
        yield
    finally:
        for logger, level in levels.items():
            logger.setLevel(level)


@contextlib.contextmanager
def spawning() -> Iterator[SpawnContext]:
    """A context whose workers begin anew, and never import from the current folder, as long as it lasts.

    `multiprocessing` starts them by `python -c`, which puts the current folder first on the path before any code of
    ours runs; there is no option for it, only the environment that they inherit.
    """
    with inherited("PYTHONSAFEPATH", "1"):
        yield multiprocessing.get_context("spawn")
