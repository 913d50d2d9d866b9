"""How far a study has come: a bar on a terminal, nothing elsewhere."""

import contextlib
import importlib.util
import sys
from collections.abc import Iterator

from node.study.study import OnProgress


@contextlib.contextmanager
def show_progress() -> Iterator[OnProgress]:
    """Show progress on standard error until the context is left."""
    if not sys.stderr.isatty() or importlib.util.find_spec("rich") is None:
        yield lambda _done, _total: None
        return
    from rich.console import Console  # noqa: PLC0415 - an extra, for terminals only
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        bar = progress.add_task("study", total=None)
        yield lambda done, total: progress.update(bar, completed=done, total=total)
