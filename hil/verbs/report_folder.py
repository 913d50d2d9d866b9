"""The folder of `--out`, into which a verb writes its report."""

import contextlib
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path

from segway_ecc.node.errors import ConfigurationError


def make_folder(folder: Path) -> None:
    """Make it before the work is done for nothing.

    Raises:
        ConfigurationError: It cannot be made.
    """
    with writing_to(folder):
        folder.mkdir(parents=True, exist_ok=True)


@contextlib.contextmanager
def writing_to(folder: Path) -> Iterator[None]:
    """Write into it; what keeps that from being done is told as the user's to mend.

    Raises:
        ConfigurationError: It cannot be written to.
    """
    try:
        yield
    except OSError as error:
        raise ConfigurationError(f"cannot write to {folder}: {error.strerror}; choose another --out") from error


def has_figures() -> bool:
    """Whether figures can be drawn here; where not, it is said."""
    found = importlib.util.find_spec("matplotlib") is not None
    if not found:
        sys.stderr.write("segway-ecc: no report: install 'segway-ecc[report]' for its figures\n")
    return found
