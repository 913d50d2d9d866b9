"""How far a campaign has come: a bar on a terminal, nothing elsewhere."""

import contextlib
import importlib.util
import sys
from collections.abc import Iterator

from node.campaign.campaign import OnProgress


@contextlib.contextmanager
def show_progress(total: int) -> Iterator[OnProgress]:
    """Show progress on standard error until the context is left."""
    if not sys.stderr.isatty() or importlib.util.find_spec("rich") is None:
        yield lambda _done, _total: None
        return
    from rich.console import Console  # noqa: PLC0415 - an extra, for terminals only
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task("campaign", total=total)
        yield lambda done, _total: progress.update(task, completed=done)
