"""A cache of compiled models of the bench's own, so that it finds none from before and leaves none behind."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from typing import Final

_NAME: Final = "XDG_CACHE_HOME"


@contextlib.contextmanager
def own_cache() -> Iterator[None]:
    """Have this process and those it starts keep compiled models in a folder that goes with the context."""
    before = os.environ.get(_NAME)
    with tempfile.TemporaryDirectory(prefix="segway-ecc-bench-") as folder:
        os.environ[_NAME] = folder
        try:
            yield
        finally:
            os.environ.pop(_NAME)
            if before is not None:
                os.environ[_NAME] = before
