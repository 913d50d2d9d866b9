# SPDX-License-Identifier: MIT
"""The folder of `--out`, into which a verb writes its report."""

import contextlib
import importlib.util
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import msgspec

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
    """Write into it.

    Raises:
        ConfigurationError: It cannot be written to.
    """
    try:
        yield
    except OSError as error:
        raise ConfigurationError(f"cannot write to {folder}: {error.strerror}; choose another --out") from error


def has_figures() -> bool:
    """Whether figures can be drawn here; where not, a message on standard error gives the remedy."""
    found = importlib.util.find_spec("matplotlib") is not None
    if not found:
        sys.stderr.write("segway-ecc: no report: install 'segway-ecc[report]' for its figures\n")
    return found


def write_report(folder: Path, name: str, document: object, draw: Callable[[], Mapping[str, str | bytes]]) -> None:
    """Write what was found as `name`.json, and the page or figures where those can be drawn.

    Args:
        folder: A folder that is there.
        name: Of the study.
        document: What it found, as JSON has it.
        draw: Makes the files of the report, by name; called only where figures can be drawn.

    Raises:
        ConfigurationError: It cannot be written.
    """
    with writing_to(folder):
        (folder / f"{name}.json").write_bytes(msgspec.json.format(msgspec.json.encode(document)))
        if has_figures():
            for file, content in draw().items():
                (folder / file).write_bytes(content.encode() if isinstance(content, str) else content)
                sys.stderr.write(f"segway-ecc: report: {folder / file}\n")
