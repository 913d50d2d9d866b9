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
    return cached(digest("fmu", content), lambda draft: _extract(path, draft))


def _extract(path: Path, folder: Path) -> None:
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            targets = [_target(path, folder, entry) for entry in entries]
            _check_size(path, entries)
            for entry, target in zip(entries, targets, strict=True):
                _write(archive, entry, target)
    except _BROKEN as error:
        raise ModelError(f"FMU {path} is broken: {error}; export or copy it again") from error


def _target(path: Path, folder: Path, entry: zipfile.ZipInfo) -> Path:
    # Some tools on Windows write its separators into the zip file.
    name = PurePosixPath(entry.filename.replace("\\", "/"))
    if name.is_absolute() or ".." in name.parts or stat.S_ISLNK(entry.external_attr >> 16):
        raise ModelError(f"FMU {path} is refused: its entry '{entry.filename}' leads out of the FMU's own folder")
    return folder / name


def _check_size(path: Path, entries: list[zipfile.ZipInfo]) -> None:
    total = sum(entry.file_size for entry in entries)
    if total > LARGEST_BYTES:
        raise ModelError(f"FMU {path} is refused: it unpacks to {total} bytes; at most {LARGEST_BYTES} are taken")


def _write(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, target: Path) -> None:
    if entry.filename.endswith(("/", "\\")):
        target.mkdir(parents=True, exist_ok=True)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    with archive.open(entry) as source, target.open("wb") as sink:
        shutil.copyfileobj(source, sink)
