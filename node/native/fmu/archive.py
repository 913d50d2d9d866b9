# SPDX-License-Identifier: MIT
"""An FMU's zip file: checked, and unpacked once into the cache. The user's file is only read."""

import shutil
import stat
import zipfile
import zlib
from pathlib import Path, PurePosixPath
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.cache import cached, digest

LARGEST_BYTES: Final = 2 * 1024**3
"""An FMU that unpacks to more than this is taken for a mistake."""

_BROKEN: Final = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError, OSError)
"""What zipfile raises on damaged, truncated, encrypted or unknown content."""


def unpack(path: Path) -> Path:
    """Return the folder that holds an FMU's content, the same for the same bytes; unpacks it where it is new.

    Args:
        path: The `.fmu` file.

    Raises:
        ModelError: It cannot be read, is no zip file, is damaged, or has an entry that leaves the folder.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ModelError(f"cannot read the FMU {path}: {error.strerror or error}") from error

    def extract(draft: Path) -> None:
        try:
            with zipfile.ZipFile(path) as archive:
                _extract(archive, path, draft)
        except _BROKEN as error:
            raise ModelError(f"FMU {path} is broken: {error}; export or copy it again") from error

    return cached(digest("fmu", content), extract)


def _extract(archive: zipfile.ZipFile, path: Path, folder: Path) -> None:
    # Some tools on Windows write its separators into the zip file.
    targets = [(entry, PurePosixPath(entry.filename.replace("\\", "/"))) for entry in archive.infolist()]
    for entry, name in targets:
        if name.is_absolute() or ".." in name.parts or stat.S_ISLNK(entry.external_attr >> 16):
            raise ModelError(f"FMU {path} is refused: its entry '{entry.filename}' leads out of the FMU's own folder")
    total = sum(entry.file_size for entry, _ in targets)
    if total > LARGEST_BYTES:
        raise ModelError(f"FMU {path} is refused: it unpacks to {total} bytes; at most {LARGEST_BYTES} are taken")
    for entry, name in targets:
        if entry.filename.endswith(("/", "\\")):
            (folder / name).mkdir(parents=True, exist_ok=True)
            continue
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with archive.open(entry) as source, (folder / name).open("wb") as sink:
            shutil.copyfileobj(source, sink)
