"""How far the study has come: bars on a terminal, a line per run elsewhere."""

import contextlib
import importlib.util
import sys
from collections.abc import Iterator

from segway_ecc.hil.case_study.conduct import OnProgress
from segway_ecc.hil.case_study.study import Seat


@contextlib.contextmanager
def show_progress() -> Iterator[OnProgress]:
    """Show progress on standard error until the context is left."""
    if not sys.stderr.isatty() or importlib.util.find_spec("rich") is None:
        yield _line
        return
    from rich.console import Console  # noqa: PLC0415 - an extra, for terminals only
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        tasks = {}

        def update(seat: Seat, done: int, total: int) -> None:
            if seat not in tasks:
                tasks[seat] = progress.add_task(str(seat), total=total)
            progress.update(tasks[seat], completed=done)

        yield update


def _line(seat: Seat, done: int, total: int) -> None:
    sys.stderr.write(f"segway-ecc: {seat}: {done} of {total} runs done\n")
