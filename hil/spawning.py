# SPDX-License-Identifier: MIT
"""Worker processes that begin anew: what this process has open or locked is not theirs."""

import contextlib
import multiprocessing
import os
from collections.abc import Iterator
from multiprocessing.context import SpawnContext
from typing import Final

_SAFE_PATH: Final = "PYTHONSAFEPATH"


@contextlib.contextmanager
def spawning() -> Iterator[SpawnContext]:
    """A context whose workers never import from the current folder, as long as it lasts.

    `multiprocessing` starts them by `python -c`, which puts the current folder first on the path before any code of
    ours runs; there is no option for it, only the environment that they inherit.
    """
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield multiprocessing.get_context("spawn")
    finally:
        if before is None:
            del os.environ[_SAFE_PATH]
        else:
            os.environ[_SAFE_PATH] = before
