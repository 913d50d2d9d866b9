# SPDX-License-Identifier: MIT
"""A support bundle: a zip of parts. One that fails is named in the manifest, and never costs the others."""

import contextlib
import hashlib
import os
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Final, NamedTuple, TypeAlias

import msgspec

from segway_ecc.deploy.support.secrets import hidden

MANIFEST: Final = "MANIFEST.json"
_PIECE: Final = 1024 * 1024
_EARLIEST: Final = (1980, 1, 1, 0, 0, 0)
"""Before which no zip can be (APPNOTE.TXT, 4.4.6)."""


class Stored(NamedTuple):
    """Bytes that are kept as they are, such as a log that is packed already.

    Attributes:
        open: Opens them; its descriptor is ours to close.
        size: How many are kept; fewer are where there are no more.
    """

    open: Callable[[], int]
    size: int


Content: TypeAlias = str | Stored
"""Text, out of which secrets are taken, or bytes as they are."""


class Collected(NamedTuple):
    """What a part found: files by their names, and what could not be had, and why."""

    files: Mapping[str, Content]
    missing: Sequence[str] = ()


Parts: TypeAlias = Mapping[str, Callable[[], Collected]]
"""What finds each part, by its name; whatever it raises is noted."""


class FileEntry(msgspec.Struct, frozen=True):
    """A file in a bundle: its size, and the SHA-256 of its content."""

    name: str
    bytes: int
    sha256: str


class PartEntry(msgspec.Struct, frozen=True):
    """What became of a part: `complete`, `partly` or `missing`, the files that it has, and what is missing, and why."""

    part: str
    state: str
    files: Sequence[FileEntry]
    missing: Sequence[str]


class BundleManifest(msgspec.Struct, frozen=True):
    """What is in a bundle, and what is not; whose it is, and when it was made, UTC."""

    about: Mapping[str, str]
    made: str
    parts: Sequence[PartEntry]


def json_text(value: object) -> str:
    """A value as JSON that people read."""
    return msgspec.json.format(msgspec.json.encode(value), indent=2).decode()


def write_bundle(path: Path, parts: Parts, about: Mapping[str, str], made: str) -> BundleManifest:
    """Write a bundle; it is there whole or not at all, and only its owner reads it.

    Raises:
        OSError: The file cannot be written.
    """
    new = path.with_name(f".{path.name}.{os.getpid()}")
    with contextlib.suppress(FileNotFoundError):
        new.unlink()
    file = os.open(new, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    try:
        with os.fdopen(file, "w+b") as stream:
            manifest = write_parts(stream, parts, about, made)
            stream.flush()
            os.fsync(stream.fileno())
        new.replace(path)
    except BaseException:
        new.unlink(missing_ok=True)
        raise
    return manifest


def write_parts(stream: IO[bytes], parts: Parts, about: Mapping[str, str], made: str) -> BundleManifest:
    """Write the parts and the manifest into an open file."""
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        manifest = BundleManifest(about, made, [_write_part(archive, *part) for part in parts.items()])
        archive.writestr(_info(MANIFEST), json_text(manifest), zipfile.ZIP_DEFLATED)
    return manifest


def _write_part(archive: zipfile.ZipFile, name: str, collect: Callable[[], Collected]) -> PartEntry:
    try:
        collected = collect()
    except Exception as error:  # noqa: BLE001 - one part must not cost the others
        return PartEntry(name, "missing", (), (hidden(_reason(error)),))
    files: list[FileEntry] = []
    missing = [hidden(text) for text in collected.missing]
    for file, content in collected.files.items():
        try:
            files.append(_write_file(archive, file, content))
        except _SourceError as error:
            missing.append(f"{file}: {error}")
    state = "missing" if not files else "partly" if missing else "complete"
    return PartEntry(name, state, files, missing)


def _write_file(archive: zipfile.ZipFile, name: str, content: Content) -> FileEntry:
    info, is_text = _info(name), isinstance(content, str)
    pieces = iter([hidden(content).encode("utf-8", "replace")]) if isinstance(content, str) else _pieces(content)
    # The first piece is read before the entry is begun: a file that is not there leaves nothing behind.
    first = next(pieces, b"")
    digest, size = hashlib.sha256(first), len(first)
    info.compress_type = zipfile.ZIP_DEFLATED if is_text else zipfile.ZIP_STORED
    with archive.open(info, "w", force_zip64=not is_text) as entry:
        entry.write(first)
        for piece in pieces:
            entry.write(piece)
            digest.update(piece)
            size += len(piece)
    return FileEntry(name, size, digest.hexdigest())


class _SourceError(Exception):
    """What was to be put in cannot be read; that the bundle cannot be written is another matter, and ends it."""


def _pieces(stored: Stored) -> Iterator[bytes]:
    file, left = None, stored.size
    try:
        file = stored.open()
        while left > 0 and (piece := os.read(file, min(left, _PIECE))):
            left -= len(piece)
            yield piece
    except OSError as error:
        raise _SourceError(_reason(error)) from error
    finally:
        if file is not None:
            os.close(file)


def _info(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name, _EARLIEST)
    info.external_attr = 0o600 << 16
    return info


def _reason(error: BaseException) -> str:
    if isinstance(error, FileNotFoundError) and not error.filename:
        return "it is not there any more"
    text = (error.strerror or str(error)) if isinstance(error, OSError) else str(error)
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
