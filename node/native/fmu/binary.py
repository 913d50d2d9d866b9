# SPDX-License-Identifier: MIT
"""The machine code of an FMU: the library for this machine, or its sources compiled; and our shim.

Sources: FMI 2.0.4, sections 2.1.1 and 2.3, and FMI 3.0.1, sections 2.5 and 2.5.1.4 (folders, buildDescription.xml);
System V ABI, chapters 4 and 5 (ELF).
"""

import os
import re
import shutil
import struct
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.compile import ELF64, cached, compile_c, compiler_identity, digest
from segway_ecc.node.native.fmu.facts import read_xml

_SHIM_SOURCES: Final = ("shim.c", "calls.h", "own_functions.h", "../repeatable.c", "../ending.h")
_SHARED: Final = ("-std=gnu11", "-O2", "-fPIC", "-shared", "-Wl,--no-undefined", "-Wl,-Bsymbolic")
_LIBRARIES: Final = ("-lm", "-ldl")
_REPEATABLE: Final = Path(__file__).parent.parent / "repeatable.c"
_PREFERRED: Final = ("x86_64-linux", "linux64", "aarch64-linux")
"""Folders to look into first where several hold a library for this machine."""
_LOADED: Final = 1
_SEGMENT: Final = struct.Struct("<IIQQQQQQ")
_INCLUDED: Final = re.compile(rb'^[ \t]*#[ \t]*include[ \t]*"([^"\r\n]+)"', re.MULTILINE)


class _Sources(NamedTuple):
    """The C files of an FMU, the preprocessor definitions (`NAME` or `NAME=value`), and folders with headers."""

    files: Sequence[Path]
    definitions: Sequence[str] = ()
    includes: Sequence[Path] = ()


def shim() -> Path:
    """Return the compiled shim, which is the same for every FMU.

    Raises:
        ModelError: There is no C compiler, or it fails.
    """
    home = Path(__file__).parent
    contents = [(home / name).read_bytes() for name in _SHIM_SOURCES]
    key = digest("fmu shim", *contents, *_SHARED, compiler_identity())

    def make(draft: Path) -> None:
        words = [*_SHARED, "-o", str(draft / "shim.so"), str(home / _SHIM_SOURCES[0]), *_LIBRARIES]
        compile_c(words, "our shim for FMUs")

    return cached(key, make) / "shim.so"


def _find_sources(folder: Path) -> _Sources:
    """What an unpacked FMU has to compile; no files where it has none."""
    root = folder / "sources"
    description = root / "buildDescription.xml"
    if description.is_file():
        found = read_xml(description, "buildDescription.xml").find("BuildConfiguration")
        if found is not None:
            definitions = [
                f"{define.get('name')}={define.get('value')}" if define.get("value") else define.get("name", "")
                for define in found.iterfind("SourceFileSet/PreprocessorDefinition")
            ]
            described, includes = (
                tuple(root / element.get("name", "") for element in found.iterfind(f"SourceFileSet/{kind}"))
                for kind in ("SourceFile", "IncludeDirectory")
            )
            return _Sources(described, definitions, includes)
    files = sorted(file for file in root.rglob("*.c") if file.is_file())
    model = read_xml(folder / "modelDescription.xml", "modelDescription.xml")
    listed = [file.get("name", "") for file in model.iterfind("CoSimulation/SourceFiles/File")]
    # 20-sim lists a fixed set of files, whatever the model needs, so its list decides nothing.
    if listed and not any(file.name.endswith("submod.c") for file in files):
        files = [root / name for name in listed if (root / name).is_file()]
    return _Sources(files)


def _compile_library(root: Path, sources: _Sources, target: Path, path: Path) -> None:
    """Compile the sources that lie below a folder into a library; `path` is the FMU itself, for messages."""
    forwarding = target.parent / "include"
    forwarding.mkdir()
    # Headers for names that differ from the file's only in case: the sources come from Windows.
    headers = {header.name.lower(): header for header in root.rglob("*") if header.suffix.lower() == ".h"}
    exact = {header.name for header in headers.values()}
    for source in root.rglob("*.[cChH]"):
        for included in _INCLUDED.findall(source.read_bytes()):
            name = included.decode(errors="replace")
            if name not in exact and "/" not in name and name.lower() in headers:
                (forwarding / name).write_text(f'#include "{headers[name.lower()]}"\n', encoding="utf-8")
    folders = {root, *sources.includes, *(header.parent for header in root.rglob("*.h"))}
    # 20-sim's sources, and others made like them, put the model's name before each function without this definition.
    definitions = [f"-D{name}" for name in ("NO_FUNCTION_PREFIX", *sources.definitions)]
    options = [*_SHARED, "-w", *definitions, *(f"-I{folder}" for folder in [*sorted(folders), forwarding])]
    compile_c(
        [*options, "-o", str(target), *map(str, sources.files), str(_REPEATABLE), *_LIBRARIES],
        f"the sources of FMU {path}",
    )


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
    sources = _find_sources(folder)
    if not sources.files:
        platforms = sorted({file.parent.name for file in every})
        only = f"binaries for {', '.join(platforms)} only, and no C sources"
        found = only if platforms else "neither binaries nor C sources"
        machine = os.uname().machine
        here = "linux64 (x86_64)" if machine == "x86_64" else f"{machine}-linux"
        raise ModelError(f"FMU {path} cannot run here: it has {found}; export it for {here} or with sources")
    key = digest("fmu sources", folder.name, _REPEATABLE.read_bytes(), *_SHARED, compiler_identity())
    built = cached(key, lambda draft: _compile_library(folder / "sources", sources, draft / f"{identifier}.so", path))
    return built / f"{identifier}.so"


def _machine(file: Path) -> bytes:
    """Word length, byte order and machine of an ELF file; nothing of another."""
    with file.open("rb") as stream:
        head = stream.read(20)
    return head[4:6] + head[18:20] if len(head) == 20 and head.startswith(b"\x7fELF") else b""  # noqa: PLR2004 - as read


def _check_whole(library: Path, path: Path) -> None:
    # The loader does not check what the header promises: a library that is cut off would end the process.
    content = library.read_bytes()
    if content[:6] != ELF64:
        return
    try:
        (start,) = struct.unpack_from("<Q", content, 0x20)
        size, count = struct.unpack_from("<HH", content, 0x36)
        segments = [_SEGMENT.unpack_from(content, start + place * size) for place in range(count)]
    except struct.error:
        segments = [(_LOADED, 0, len(content), 0, 0, 1)]
    if any(kind == _LOADED and offset + length > len(content) for kind, _, offset, _, _, length, *_ in segments):
        raise ModelError(f"FMU {path} is broken: its library {library.name} is cut off; export it again")


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
