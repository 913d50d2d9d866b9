"""The machine code of an FMU: the library for this machine, or its sources compiled; and what a library exports.

Sources: FMI 2.0.4, section 2.3 and FMI 3.0.1, section 2.5 (the folders); System V ABI, chapters 4 and 5 (ELF).
"""

import os
import shutil
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.cache import cached, digest
from segway_ecc.node.native.fmu.compile import compile_library, compiler, find_sources

_PREFERRED: Final = ("x86_64-linux", "linux64", "aarch64-linux")
"""Folders to look into first where several hold a library for this machine."""

_MACHINE: Final = slice(4, 20)
"""Where an ELF file says its word length, byte order, kind and machine; the kind, of 2 bytes, is left out below."""

_ELF64: Final = b"\x7fELF\x02\x01"
"""64 bits, little-endian: every machine that the project runs on."""

_DYNAMIC_SYMBOLS: Final = 11
_LOADED: Final = 1
_SEGMENT: Final = struct.Struct("<IIQQQQQQ")
_SYMBOL: Final = struct.Struct("<IBBHQQ")
_SECTION: Final = struct.Struct("<IIQQQQIIQQ")


def find_library(folder: Path, identifier: str, path: Path) -> Path:
    """Return the FMU's library for this machine, compiled from its sources where it brings none.

    Args:
        folder: Where the FMU is unpacked.
        identifier: Base name of the library.
        path: The FMU itself, for messages.

    Raises:
        ModelError: There is neither a library for this machine nor sources, or they do not compile.
    """
    libraries = sorted((folder / "binaries").glob("*/*"), key=lambda file: file.parent.name not in _PREFERRED)
    for library in libraries:
        if library.name == f"{identifier}.so" and _runs_here(library):
            _check_whole(library, path)
            return library
    sources = find_sources(folder)
    if not sources.files:
        raise ModelError(
            f"FMU {path} cannot run here: {_what_there_is(folder)}; export it for {_here()} or with sources"
        )
    key = digest("fmu sources", folder.name, *compiler())
    built = cached(key, lambda draft: compile_library(sources, draft / f"{identifier}.so", path))
    return built / f"{identifier}.so"


def _what_there_is(folder: Path) -> str:
    platforms = sorted({file.parent.name for file in (folder / "binaries").glob("*/*")})
    if not platforms:
        return "it has neither binaries nor C sources"
    return f"it has binaries for {', '.join(platforms)} only, and no C sources"


def _here() -> str:
    machine = os.uname().machine
    return "linux64 (x86_64)" if machine == "x86_64" else f"{machine}-linux"


def _runs_here(library: Path) -> bool:
    mine, its = _machine(Path(sys.executable)), _machine(library)
    return its is not None and its == mine


def _machine(file: Path) -> bytes | None:
    with file.open("rb") as stream:
        head = stream.read(_MACHINE.stop)
    if len(head) < _MACHINE.stop or not head.startswith(b"\x7fELF"):
        return None
    return head[4:6] + head[18:20]


def exported(library: Path) -> frozenset[str]:
    """Return the names that a library exports; none where it is not 64-bit little-endian ELF."""
    content = library.read_bytes()
    if content[:6] != _ELF64:
        return frozenset()
    try:
        return frozenset(_exported(content))
    except (struct.error, IndexError, ValueError):
        # The loader is the one to say what is wrong with it.
        return frozenset()


def _check_whole(library: Path, path: Path) -> None:
    # The loader does not check what the header promises: a library that is cut off would end the process.
    content = library.read_bytes()
    if content[:6] != _ELF64:
        return
    try:
        (start,) = struct.unpack_from("<Q", content, 0x20)
        size, count = struct.unpack_from("<HH", content, 0x36)
        segments = [_SEGMENT.unpack_from(content, start + place * size) for place in range(count)]
    except struct.error:
        segments = [(_LOADED, 0, len(content), 0, 0, 1)]
    if any(kind == _LOADED and offset + length > len(content) for kind, _, offset, _, _, length, *_ in segments):
        raise ModelError(f"FMU {path} is broken: its library {library.name} is cut off; export it again")


def _exported(content: bytes) -> Iterator[str]:
    (start,) = struct.unpack_from("<Q", content, 0x28)
    size, count = struct.unpack_from("<HH", content, 0x3A)
    sections = [_SECTION.unpack_from(content, start + place * size) for place in range(count)]
    for _, kind, _, _, offset, length, link, *_ in sections:
        if kind != _DYNAMIC_SYMBOLS:
            continue
        names = sections[link][4]
        for symbol in _SYMBOL.iter_unpack(content[offset : offset + length]):
            name, _, _, section = symbol[:4]
            if section:
                first = names + name
                yield content[first : content.index(b"\0", first)].decode(errors="replace")


def private_copy(library: Path, resources: Path, place: Path) -> Path:
    """Copy a library and its companions for one instance, laid out as in the FMU; return the copy.

    The loader gives two users of one file the same globals, so each instance has a file of its own.

    Raises:
        ModelError: There is no room for it.
    """
    home = place / "binaries" / library.parent.name
    try:
        shutil.copytree(library.parent, home)
        if resources.is_dir():
            # Some FMUs look for their resources from where their library lies.
            (place / "resources").symlink_to(resources)
    except OSError as error:
        raise ModelError(f"cannot copy {library} to {place}: {error}; make room there") from error
    return home / library.name
