# SPDX-License-Identifier: MIT
"""Compiling a 20-sim model into a shared object with our interface, once per content.

Every file that goes in is written out under its own name below a folder of the cache, and compiled there: the user's
folder is never written to, may be moved or renamed, and its path may hold any character.

Headers that a folder lacks are made on our side of the include path: folders come from file systems that ignore case,
are moved about, and are copied in part. What is there under another spelling or in another place is forwarded to; what
only declares functions that the code may never call is left empty, and what it calls all the same is then named by the
linker.
"""

import os
import posixpath
import re
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.compile import cached, compiler_identity, digest, run_compiler
from segway_ecc.node.native.twenty_sim.files import CPP_SUFFIXES, TREE, Folder, code_of
from segway_ecc.node.native.twenty_sim.parts import Parts

_COMPILE: Final = ("-O2", "-fPIC", "-c")
_C: Final = ("-std=gnu11",)
# Without the last, the loader shares some of C++'s symbols among all instances of a process.
_CPP: Final = ("-std=c++17", "-fno-gnu-unique")
_SHIM_CPP: Final = ("-fno-access-control",)
_LINK: Final = ("-shared", "-Wl,--no-undefined", "-Wl,-Bsymbolic", "-lm", "-ldl")
_LIBRARY: Final = "model.so"
_SYSCALL: Final = re.compile(r"\bsyscall\b(?!\.h)")
_SYSCALL_SHIM: Final = ("-DECC_SYSCALL=__wrap_syscall", "-DECC_REAL_SYSCALL=__real_syscall")
_SYSCALL_LINK: Final = "-Wl,--wrap=syscall"
"""Only for code that calls it, which `repeatability_warnings` goes by."""
_WARNINGS: Final = "warnings.txt"
_OWN_FUNCTIONS: Final = ("Matrix", "Inverse", "MotionProfile", "Euler")
_INCLUDE: Final = re.compile(r"^[ \t]*#[ \t]*include[ \t]*([\"<])([^\">\n]+)[\">]", re.MULTILINE)
_MAY_BE_EMPTY: Final = ("motionprofiles", "eulerangles", "matrix", "inverse", "integ", "funcs")


def build(parts: Parts, header: str, model: bytes) -> tuple[Path, tuple[str, ...]]:
    """Compile a model, or find it compiled.

    Args:
        parts: The model.
        header: The text of ecc_model.h, which shim.c includes.
        model: The content of the file with the equations, in place of its own.

    Returns:
        The shared object, and what the code itself warned of while it was compiled.

    Raises:
        ModelError: There is no compiler, a file or function is missing, or the code does not compile.
    """
    folder = parts.folder
    ending = "cpp" if parts.is_cpp else "c"
    files = {f"{TREE}/{file.name}": file.content for file in (*folder.sources, *folder.headers)}
    files[f"{TREE}/{parts.model.name}"] = model
    files |= {f"supplied/{name}": text.encode() for name, text in _supplied_headers(folder).items()}
    home, ours = Path(__file__).parent, (f"shim/shim.{ending}", f"shim/repeatable.{ending}")
    files |= {ours[0]: (home / "shim.c").read_bytes(), ours[1]: (home.parent / "repeatable.c").read_bytes()}
    files |= {"shim/ending.h": (home.parent / "ending.h").read_bytes(), "shim/ecc_model.h": header.encode()}
    units = [*(f"{TREE}/{source.name}" for source in folder.sources), *ours]
    includes = [*(f"-I{TREE}/{place}" for place in folder.include_folders), "-Isupplied", "-I."]
    calls_by_number = any(_SYSCALL.search(file.code) for file in (*folder.sources, *folder.headers))
    commands = []
    for index, unit in enumerate(units):
        cpp = Path(unit).suffix.lower() in CPP_SUFFIXES
        own = (*(_CPP if cpp else _C), *(_SHIM_CPP if cpp and unit.startswith("shim/") else ()))
        own += _SYSCALL_SHIM if unit == ours[0] and calls_by_number else ()
        commands.append((cpp, [*_COMPILE, *own, *includes, "-o", f"{index}.o", unit]))
    objects = [f"{index}.o" for index in range(len(units))]
    link = (*_LINK, _SYSCALL_LINK) if calls_by_number else _LINK
    commands.append((parts.is_cpp, [*objects, *link, "-o", f"../{_LIBRARY}"]))
    identities = [compiler_identity(cpp=cpp) for cpp in sorted({cpp for cpp, _ in commands})]
    named = [part for name, content in sorted(files.items()) for part in (os.fsencode(name), content)]
    key = digest(*named, *(word for _, words in commands for word in words), *identities)
    entry = cached(key, lambda draft: _make(folder, files, commands, draft, draft.parent / f"{key}.log"))
    return entry / _LIBRARY, tuple((entry / _WARNINGS).read_text(encoding="utf-8").splitlines())


def _supplied_headers(folder: Folder) -> dict[str, str]:
    """Return the text of each header that an include asks for and the folder does not have, by the name asked for."""
    files = {file.name for file in folder.headers}
    found: dict[str, str] = {}
    for source in (*folder.sources, *folder.headers):
        places = [posixpath.dirname(source.name), *folder.include_folders]
        for match in _INCLUDE.finditer(code_of(source.text, keep_strings=True)):
            name = match[2].replace("\\", "/").strip()
            is_there = any(posixpath.normpath(posixpath.join(place, name)) in files for place in places)
            if not is_there and (text := _stand_in(folder, posixpath.basename(name).lower())):
                found.setdefault(match[2].strip(), text)
    return found


def _stand_in(folder: Folder, wanted: str) -> str:
    """A header that forwards to one whose name differs in case or place, or declares nothing; else nothing."""
    same = [file.name for file in folder.headers if posixpath.basename(file.name).lower() == wanted]
    if same:
        return f'#include "{TREE}/{min(same, key=len)}"\n'
    if not any(part in wanted for part in _MAY_BE_EMPTY):
        return ""
    return "/* Not in the folder; supplied empty by segway-ecc. */\n" + (_matrix(folder) if "matrix" in wanted else "")


def _matrix(folder: Folder) -> str:
    """The matrix type, which releases up to 4.6 declare in the header of the matrix functions."""
    pattern = re.compile(r"\btypedef\s+\w+\s+(\w*)Double\s*;")
    for header in folder.headers:
        match = pattern.search(header.code)
        if match and not re.search(rf"\b{match[1]}Matrix\s*;", header.code):
            p = match[1]
            guard = f"#ifndef ECC_{p}MATRIX\n#define ECC_{p}MATRIX\n"
            fields = f"{p}Double *mat; {p}Integer rows; {p}Integer columns;"
            return f'#include "{TREE}/{header.name}"\n{guard}typedef struct {{ {fields} }} {p}Matrix;\n#endif\n'
    return ""


def _make(
    folder: Folder, files: Mapping[str, bytes], commands: Iterable[tuple[bool, list[str]]], draft: Path, log: Path
) -> None:
    """Write the files, and run the compiler for C++ or C with the words of each command."""
    work = draft / "work"
    for name, content in files.items():
        file = work / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    output = ""
    for cpp, words in commands:
        code, printed = run_compiler(words, cpp=cpp, folder=work)
        output += printed
        if code:
            log.write_text(output, encoding="utf-8")
            raise ModelError(f"{_failure(folder.path, printed)}; the whole output is in {log}")
    (draft / _WARNINGS).write_text("".join(f"{line}\n" for line in _warnings(output, folder)), encoding="utf-8")
    shutil.rmtree(work)


def _failure(path: Path, output: str) -> str:
    missing = dict.fromkeys(re.findall(r"undefined reference to [`'](.+?)'", output))
    if missing:
        own = any(part in name for name in missing for part in _OWN_FUNCTIONS)
        what = "copy the rest of 20-sim's files too" if own else "add the source of the library it is in"
        return f"the model in {path} calls {', '.join(missing)}, which no file there defines: {what}"
    header = re.search(rf"^{TREE}/(\S[^:\n]*):\d+.*fatal error: (.+?): No such file", output, re.MULTILINE)
    if header:
        return f"{header[1]} in {path} includes {header[2]}, which is not there: add it"
    lines = [line for line in output.splitlines() if "error" in line] or output.splitlines() or ["it prints nothing"]
    return f"the model in {path} does not compile: {lines[0].removeprefix(f'{TREE}/')}"


def _warnings(output: str, folder: Folder) -> list[str]:
    """What the code itself warns of (`#warning` about algebraic loops or dependent states), and what C guesses."""
    own = re.findall(rf"^{TREE}/([^:\n]+):\d+.*warning: #warning (.*?)(?: \[-W.*)?$", output, re.MULTILINE)
    guessed = re.findall(rf"^{TREE}/([^:\n]+):\d+.*: implicit declaration of function '(\w+)'", output, re.MULTILINE)
    results = {name: found.result for source in folder.sources for name, found in source.functions.items()}
    found = [f"{file}: {text.strip().strip(chr(34))}" for file, text in own]
    found += [
        f"{file} calls {name} without declaring it, so that C takes its result for a whole number"
        for file, name in guessed
        if results.get(name, "int") not in ("int", "void")
    ]
    return list(dict.fromkeys(found))
