# SPDX-License-Identifier: MIT
"""The machine code of an FMU: the library for this machine, or its sources compiled; and what a library exports.

Sources: FMI 2.0.4, section 2.3 and FMI 3.0.1, section 2.5 (the folders); System V ABI, chapters 4 and 5 (ELF).
"""

import os
import shutil
import struct
import sys
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.cache import cached, digest
from segway_ecc.node.native.fmu.compile import compile_library, compiler, find_sources

_PREFERRED: Final = ("x86_64-linux", "linux64", "aarch64-linux")
"""Folders to look into first where several hold a library for this machine."""

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
    every = sorted((folder / "binaries").glob("*/*"))
    for library in sorted(every, key=lambda file: file.parent.name not in _PREFERRED):
        if library.name == f"{identifier}.so" and _machine(library) == _machine(Path(sys.executable)) != b"":
            _check_whole(library, path)
            return library
    sources = find_sources(folder)
    if not sources.files:
        platforms = sorted({file.parent.name for file in every})
        found = (
            f"binaries for {', '.join(platforms)} only, and no C sources"
            if platforms
            else "neither binaries nor C sources"
        )
        machine = os.uname().machine
        here = "linux64 (x86_64)" if machine == "x86_64" else f"{machine}-linux"
        raise ModelError(f"FMU {path} cannot run here: it has {found}; export it for {here} or with sources")
    key = digest("fmu sources", folder.name, *compiler())
    built = cached(key, lambda draft: compile_library(sources, draft / f"{identifier}.so", path))
    return built / f"{identifier}.so"


def _machine(file: Path) -> bytes:
    """Word length, byte order and machine of an ELF file; nothing of another."""
    with file.open("rb") as stream:
        head = stream.read(20)
    return head[4:6] + head[18:20] if len(head) == 20 and head.startswith(b"\x7fELF") else b""  # noqa: PLR2004 - as read


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


def exported(library: Path) -> frozenset[str]:
    """Return the names that a library exports; none where it is not 64-bit little-endian ELF."""
    content = library.read_bytes()
    if content[:6] != _ELF64:
        return frozenset()
    found = set()
    try:
        (start,) = struct.unpack_from("<Q", content, 0x28)
        size, count = struct.unpack_from("<HH", content, 0x3A)
        sections = [_SECTION.unpack_from(content, start + place * size) for place in range(count)]
        for _, kind, _, _, offset, length, link, *_ in sections:
            if kind == _DYNAMIC_SYMBOLS:
                for symbol in _SYMBOL.iter_unpack(content[offset : offset + length]):
                    first = sections[link][4] + symbol[0]
                    if symbol[3]:  # its section: it is defined here
                        found.add(content[first : content.index(b"\0", first)].decode(errors="replace"))
    except (struct.error, IndexError, ValueError):
        return frozenset()  # the loader is the one to report what is wrong with it
    return frozenset(found)


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
