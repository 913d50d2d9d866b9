# SPDX-License-Identifier: MIT
"""A support bundle: a zip of parts. One that fails is named in the manifest, and never costs the others.

Secrets are kept out of it: by their names, and by what tokens and keys look like.
"""

import contextlib
import errno
import hashlib
import itertools
import os
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Final, NamedTuple, TypeAlias

import msgspec

MANIFEST: Final = "MANIFEST.json"
_PIECE: Final = 1024 * 1024
_EARLIEST: Final = (1980, 1, 1, 0, 0, 0)
"""Before which no zip can be (APPNOTE.TXT, 4.4.6)."""
HIDDEN: Final = "[hidden]"
_KEPT_VARIABLES: Final = re.compile(
    r"(ROS|RMW|RCUTILS|RCL|FASTRTPS|FASTDDS|CYCLONEDDS|AMENT|COLCON|PYTHON|LC|XDG|SEGWAY_ECC)_\w*"
    r"|LANG|PATH|PYTHONPATH|LD_LIBRARY_PATH|VIRTUAL_ENV|TZ|TERM|SHELL|CYCLONEDDS_URI|INVOCATION_ID"
)
_WORDS_FOR_IT: Final = (
    r"(?:token|secret|passw(?:or)?d|passphrase|passwd|pwd|credentials?|cookie|authori[sz]ation|bearer"
    r"|(?:api|access|private|preshared|pre_shared|secret|signing|encryption)[ _-]?key|psk|auth)"
)
_NAMED: Final = re.compile(
    rf"(?i)(?<![a-z])((?:[\w.-]{{0,40}}[_.-])?{_WORDS_FOR_IT}s?(?:[_-][\w-]{{0,40}})?[\"']?\s*(?:[=:]|\s(?=(?:is|bearer|basic)\s))\s*)"
    r"(?:(?:is|bearer|basic)\s+)?(\"[^\"\n]*\"|'[^'\n]*'|[^\s,;&\"']+)"
)
_SECRET_NAME: Final = re.compile(r"(?i)token|secret|passw|passphrase|pwd|credential|cookie|auth|key|psk|private")
_IN_URL: Final = re.compile(r"(?<=://)([^\s/:@]*):([^\s/@]+)(?=@)")
_PEM: Final = re.compile(r"-----BEGIN [^-\n]*-----.*?(?:-----END [^-\n]*-----|\Z)", re.DOTALL)
_WORD: Final = re.compile(r"(?<![\w+/-])[\w+/-]{20,}={0,2}(?![\w+/=-])", re.ASCII)
_ROLE: Final = re.compile(r"\b((?:operator|viewer)\s{2,})\S{16,}")
"""The base station's tokens, as it shows them at its first start; a journal keeps that."""
_RANDOM: Final = (re.compile(r"[0-9]"), re.compile(r"[a-z]"), re.compile(r"[A-Z]"))
_CASES: Final = _RANDOM[1:]
_OFTEN: Final = 0.36
"""Changes between capitals, small letters, digits and the rest, for each letter: 0.65 in a token, 0.3 in a path."""


class Stored(NamedTuple):
    """Bytes that are kept as they are, such as a log that is packed already.

    `open` opens them, its descriptor ours to close; at most `size` are kept, fewer where there are no more.
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
    """Write a bundle; it is there whole or not at all, and only its owner reads it. Through a link, where it points.

    Raises:
        OSError: The file cannot be written, or there is something other than a file.
    """
    path = path.resolve()
    if path.exists() and not path.is_file():
        raise FileExistsError(errno.EEXIST, "there is something other than a file", str(path))
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


def hidden(text: str) -> str:
    """A text without secrets: what is named as one, what is in a URL, PEM, and words that look made at random."""

    def without_value(found: re.Match[str]) -> str:
        # What names the secret, and nothing of it; quotes stay, so that JSON stays JSON.
        quote = found[2][0] if found[2][0] in "\"'" else ""
        return f"{found[1]}{quote}{HIDDEN}{quote}"

    text = _PEM.sub(HIDDEN, text)
    text = _IN_URL.sub(rf"\1:{HIDDEN}", text)
    text = _ROLE.sub(rf"\1{HIDDEN}", text)
    text = _NAMED.sub(without_value, text)
    return _WORD.sub(lambda found: HIDDEN if _is_random(found[0]) else found[0], text)


def environment(variables: Mapping[str, str]) -> dict[str, str]:
    """Of the environment what concerns us, without what looks like a secret."""
    return {
        name: hidden(text)
        for name, text in sorted(variables.items())
        if _KEPT_VARIABLES.fullmatch(name) and not _SECRET_NAME.search(name)
    }


def _is_random(word: str) -> bool:
    """Whether a long word is a token or a key, and no path, name or hash (which has small letters only)."""
    if not all(kind.search(word) for kind in _CASES):
        return False
    # How often it goes from one kind of letter to another.
    kinds = [next((n for n, kind in enumerate(_RANDOM) if kind.match(letter)), -1) for letter in word]
    return sum(one != other for one, other in itertools.pairwise(kinds)) >= _OFTEN * len(word)
