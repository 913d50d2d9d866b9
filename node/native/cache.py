# SPDX-License-Identifier: MIT
"""Where what was compiled or unpacked is kept, by content, so that it is done once.

The place follows the XDG Base Directory Specification 0.8: `$XDG_CACHE_HOME`, or `~/.cache` where that is unset or
relative. Deleting it costs only the time to make its entries again.
"""

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import ModelError

_PLACE: Final = Path("segway-ecc", "models")


def digest(*parts: bytes | str) -> str:
    """Return a name for content: equal only for equal parts in equal order."""
    total = hashlib.sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        # With its length, so that moving the border between two parts makes another name.
        total.update(len(content).to_bytes(8, "little"))
        total.update(content)
    return total.hexdigest()[:32]


def cached(key: str, make: Callable[[Path], None]) -> Path:
    """Return the folder of an entry, making it first where it is not there.

    Safe among processes: an entry is made beside its place and renamed into it whole, and the first one there wins.

    Args:
        key: Name of the entry, from `digest` over everything that decides its content.
        make: Fills the empty folder it is given. What it raises is passed on, and nothing is kept.

    Raises:
        ModelError: The cache cannot be written.
    """
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    entry = (given if given.is_absolute() else Path.home() / ".cache") / _PLACE / key
    if entry.is_dir():
        return entry
    try:
        entry.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{key}-", dir=entry.parent))
    except OSError as error:
        raise ModelError(f"cannot write to the cache {entry.parent}: {error}; set XDG_CACHE_HOME elsewhere") from error
    try:
        make(draft)
        try:
            draft.rename(entry)
        except OSError as error:
            # Another process was first, and its content is the same.
            if not entry.is_dir():
                raise ModelError(f"cannot keep {entry} in the cache: {error}") from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return entry
