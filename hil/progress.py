# SPDX-License-Identifier: MIT
"""How far something long has come: bars on a terminal; elsewhere nothing, or a line at the end."""

import contextlib
import importlib.util
import sys
from collections.abc import Callable, Iterator

OnProgress = Callable[[int, int], None]
"""Called with how much is done, and of how much."""
OnSeconds = Callable[[float], None]
"""Called with the seconds done so far, simulated or on the clock."""


@contextlib.contextmanager
def show_all_progress(*, lines: bool = False) -> Iterator[Callable[[str, int, int | None], None]]:
    """Show a bar for each name on standard error until the context is left; with `lines`, elsewhere a line at its end.

    It yields what is to be called with a name, how much of it is done, and of how much (None while that is unknown).
    """
    if not sys.stderr.isatty() or importlib.util.find_spec("rich") is None:

        def write(name: str, done: int, total: int | None) -> None:
            if lines and done == total:
                sys.stderr.write(f"segway-ecc: {name}: {done} of {total} runs done\n")

        yield write
        return
    from rich.console import Console  # noqa: PLC0415 - an extra, for terminals only
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        tasks = {}

        def update(name: str, done: int, total: int | None) -> None:
            if name not in tasks:
                tasks[name] = progress.add_task(name, total=total)
            progress.update(tasks[name], completed=done, total=total)

        yield update


@contextlib.contextmanager
def show_progress(what: str, total: int | None = None) -> Iterator[OnProgress]:
    """Show the progress of `what` alone; `total` where it is known before."""
    with show_all_progress() as update:
        update(what, 0, total)
        yield lambda done, of: update(what, done, of)
