"""How far something long has come: a bar on a terminal, nothing elsewhere."""

import contextlib
import importlib.util
import sys
from collections.abc import Callable, Iterator

OnProgress = Callable[[int, int], None]
"""Called with how much is done, and of how much."""


@contextlib.contextmanager
def show_progress(what: str, total: int | None = None) -> Iterator[OnProgress]:
    """Show the progress of `what` on standard error until the context is left; `total` where it is known before."""
    if not sys.stderr.isatty() or importlib.util.find_spec("rich") is None:
        yield lambda _done, _total: None
        return
    from rich.console import Console  # noqa: PLC0415 - an extra, for terminals only
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done, of: progress.update(task, completed=done, total=of)
