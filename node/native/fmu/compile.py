# SPDX-License-Identifier: MIT
"""Compiling for FMUs: our shim, and the sources of an FMU that has no library for this machine.

Sources: FMI 2.0.4, sections 2.1.1 and 2.3; FMI 3.0.1, section 2.5.1.4 (buildDescription.xml).
"""

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.cache import cached, digest
from segway_ecc.node.native.fmu.xml import read_xml

_SHIM_SOURCES: Final = ("shim.c", "calls.h")
_SHARED: Final = ("-std=gnu11", "-O2", "-fPIC", "-shared", "-Wl,--no-undefined", "-Wl,-Bsymbolic")
_LIBRARIES: Final = ("-lm", "-ldl")
_TIMEOUT_S: Final = 600.0
_INCLUDED: Final = re.compile(rb'^[ \t]*#[ \t]*include[ \t]*"([^"\r\n]+)"', re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Sources:
    """What to compile.

    Attributes:
        root: The FMU's folder of sources.
        files: The C files.
        definitions: Preprocessor definitions, `NAME` or `NAME=value`.
        includes: Folders to search for headers.
    """

    root: Path
    files: tuple[Path, ...]
    definitions: tuple[str, ...] = ()
    includes: tuple[Path, ...] = ()


def compiler() -> tuple[str, ...]:
    """Return the C compiler's command and what else decides its output.

    Raises:
        ModelError: There is none.
    """
    found = os.environ.get("CC") or next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)
    if found is None or shutil.which(found) is None:
        raise ModelError("no C compiler is found, and an FMU needs one: install gcc, or name one in the variable CC")
    return (found, str(Path(shutil.which(found) or found).resolve()), *_SHARED)


def shim() -> Path:
    """Return the compiled shim, which is the same for every FMU.

    Raises:
        ModelError: There is no C compiler, or it fails.
    """
    home = Path(__file__).parent
    contents = [(home / name).read_bytes() for name in _SHIM_SOURCES]
    key = digest("fmu shim", *contents, *compiler())

    def make(draft: Path) -> None:
        _run([*_SHARED, "-o", str(draft / "shim.so"), str(home / _SHIM_SOURCES[0]), *_LIBRARIES], "our shim for FMUs")

    return cached(key, make) / "shim.so"


def find_sources(folder: Path) -> Sources:
    """Return what an unpacked FMU has to compile; no files where it has none."""
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
            return Sources(root, described, tuple(definitions), includes)
    files = tuple(sorted(file for file in root.rglob("*.c") if file.is_file()))
    model = read_xml(folder / "modelDescription.xml", "modelDescription.xml")
    listed = [file.get("name", "") for file in model.iterfind("CoSimulation/SourceFiles/File")]
    # 20-sim lists a fixed set of files, whatever the model needs, so its list decides nothing.
    if listed and not any(file.name.endswith("submod.c") for file in files):
        files = tuple(root / name for name in listed if (root / name).is_file())
    return Sources(root, files)


def compile_library(sources: Sources, target: Path, path: Path) -> None:
    """Compile an FMU's sources into a library.

    Args:
        sources: What to compile.
        target: The library to write.
        path: The FMU itself, for messages.

    Raises:
        ModelError: They do not compile; the text has the compiler's first complaint.
    """
    forwarding = target.parent / "include"
    forwarding.mkdir()
    # Headers for names that differ from the file's only in case: the sources come from Windows.
    headers = {header.name.lower(): header for header in sources.root.rglob("*") if header.suffix.lower() == ".h"}
    exact = {header.name for header in headers.values()}
    for source in sources.root.rglob("*.[cChH]"):
        for included in _INCLUDED.findall(source.read_bytes()):
            name = included.decode(errors="replace")
            if name not in exact and "/" not in name and name.lower() in headers:
                (forwarding / name).write_text(f'#include "{headers[name.lower()]}"\n', encoding="utf-8")
    folders = {sources.root, *sources.includes, *(header.parent for header in sources.root.rglob("*.h"))}
    # 20-sim's sources, and others made like them, put the model's name before each function without this definition.
    definitions = [f"-D{name}" for name in ("NO_FUNCTION_PREFIX", *sources.definitions)]
    options = [*_SHARED, "-w", *definitions, *(f"-I{folder}" for folder in [*sorted(folders), forwarding])]
    _run([*options, "-o", str(target), *map(str, sources.files), *_LIBRARIES], f"the sources of FMU {path}")


def _run(arguments: list[str], what: str) -> None:
    command = [compiler()[0], *arguments]
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=_TIMEOUT_S)  # noqa: S603 - the compiler
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ModelError(f"cannot compile {what}: {error}") from error
    if done.returncode != 0:
        lines = [line.strip() for line in done.stderr.decode(errors="replace").splitlines() if line.strip()]
        errors = [line for line in lines if "error" in line or "undefined reference" in line]
        reason = next(iter(errors or lines), "the compiler gives no reason")
        raise ModelError(f"cannot compile {what}: {reason}")
