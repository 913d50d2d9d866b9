# SPDX-License-Identifier: MIT
"""Compiling with this machine's compilers, the cache of what was compiled or unpacked, and the names in a library.

The cache follows the XDG Base Directory Specification 0.8: `$XDG_CACHE_HOME`, or `~/.cache` where that is unset or
relative. Deleting it costs only the time to make its entries again. The names that a shared object exports and imports
are found by the System V ABI, chapters 4 and 5 (ELF).
"""

import hashlib
import os
import re
import shlex
import shutil
import struct
import subprocess
import tempfile
from collections.abc import Callable, Container, Iterator, Sequence
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.folders import cache_folder

_PLACE: Final = "models"
_TIMEOUT_S: Final = 600.0
SAME_BITS: Final = ("-ffp-contract=off", "-fsigned-char")
"""So that every processor computes as x86-64 does by default: gcc for arm64 fuses multiply-add, which rounds once and
not twice, and its plain `char` (20-sim's XXBoolean) has no sign."""
ELF64: Final = b"\x7fELF\x02\x01"
"""64 bits, little-endian: every machine that the project runs on."""
_DYNAMIC_SYMBOLS: Final = 11
_SYMBOL: Final = struct.Struct("<IBBHQQ")
_SECTION: Final = struct.Struct("<IIQQQQIIQQ")
_UNREPEATABLE: Final = re.compile(
    r"(s?rand|s?random|initstate|setstate|[dlm]rand48|srand48|seed48|lcong48|getrandom|getentropy|arc4random\w*"
    r"|rand_r|time|clock|times|ftime|gettimeofday|clock_gettime|timespec_get|localtime(?:_r)?|mktime|ctime(?:_r)?|strftime"
    r"|getp?pid|gettid|getpgrp|getsid|get[eu]?[ug]id|getlogin(?:_r)?|pthread_self|thrd_current|sched_getcpu"
    r"|(?:secure_)?getenv|gethostname|gethostid|uname|sysinfo|getcwd|getrusage|syscall|getauxval"
    r"|socket|recv|recvfrom|mktemp|mkstemp|mkdtemp|tmpnam|tempnam|popen|system)$"
    r"|_ZNSt(13random_device)|_ZNSt6(chrono)\w*3nowEv"
)
"""Whose values a replay cannot repeat: random numbers that all of a process draw from or that a caller's seed may vary,
clocks and the time zone, what process, user and machine it is, and what comes from outside; of C, POSIX and C++."""


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
        ConfigurationError: The user has no home folder.
        ModelError: The cache cannot be written.
    """
    entry = cache_folder() / _PLACE / key
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


def find_compiler(*, cpp: bool = False) -> list[str]:
    """Return the command of the C or C++ compiler: the one that the variable CC or CXX names, or else the machine's.

    It ends with `SAME_BITS`, which so decides over what the variable has.

    Raises:
        ModelError: There is none.
    """
    what, package, variable = ("C++", "g++", "CXX") if cpp else ("C", "gcc", "CC")
    if given := shlex.split(os.environ.get(variable, "")):
        if (found := shutil.which(given[0])) is None:
            raise ModelError(f"there is no compiler {given[0]}, which the variable {variable} names: install it")
        return [found, *given[1:], *SAME_BITS]
    names = ("g++", "c++", "clang++") if cpp else ("gcc", "cc", "clang")
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        raise ModelError(f"there is no {what} compiler here: sudo apt install {package} libc6-dev")
    return [found, *SAME_BITS]


def missing_compiler() -> str | None:
    """Why no C can be compiled here, with the remedy; None where it can."""
    try:
        find_compiler()
    except ModelError as error:
        return str(error)
    return None


def compiler_identity(*, cpp: bool = False) -> str:
    """Return what identifies the compiler and its version without running it; raises as `find_compiler`."""
    compiler, *words = find_compiler(cpp=cpp)
    path = Path(compiler).resolve()
    return " ".join([path.name, str(path.stat().st_size), str(path.stat().st_mtime_ns), *words])


def run_compiler(
    words: Sequence[str], *, cpp: bool = False, folder: Path | None = None, source: bytes | None = None
) -> tuple[int, str]:
    """Run the compiler in a folder, on files or a source; return its exit code and its output, in English.

    Raises:
        ModelError: There is none, or it cannot be run to its end.
    """
    command = [*find_compiler(cpp=cpp), *words]
    environment = os.environ | {"LC_ALL": "C"}
    try:
        done = subprocess.run(  # noqa: S603 - a compiler
            command, cwd=folder, env=environment, input=source, capture_output=True, check=False, timeout=_TIMEOUT_S
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ModelError(f"cannot run the compiler {command[0]}: {error}") from error
    made = (folder or Path()) / words[words.index("-o") + 1] if "-o" in words else None
    if done.returncode == 0 and made is not None and not made.exists():
        raise ModelError(f"the compiler {command[0]} ended well and wrote nothing: let CC and CXX name real ones")
    return done.returncode, (done.stdout + done.stderr).decode(errors="replace")


def compile_c(words: Sequence[str], what: str, source: bytes | None = None) -> None:
    """Compile C; see `run_compiler`.

    Raises:
        ModelError: It does not compile: the text names what, and has the compiler's first complaint.
    """
    code, output = run_compiler(words, source=source)
    if code:
        lines = [line.strip() for line in output.splitlines() if line.strip()]
        errors = [line for line in lines if "error" in line or "undefined reference" in line]
        raise ModelError(f"cannot compile {what}: {next(iter(errors or lines), 'the compiler gives no reason')}")


def exported(library: Path) -> frozenset[str]:
    """Return the names that a library exports; none where it is not 64-bit little-endian ELF."""
    return frozenset(name for name, is_defined in _symbols(library) if is_defined)


def repeatability_warnings(library: Path, given: Container[str] = ()) -> tuple[str, ...]:
    """Return a line where a library calls what gives other values in each run, instance or start; else nothing.

    Functions that it is `given` in place of the C library's are repeatable.
    """
    called = (name for name, is_defined in _symbols(library) if not is_defined and name not in given)
    found = map(_UNREPEATABLE.match, called)
    names = sorted({next(filter(None, match.groups())).lstrip("0123456789") for match in found if match})
    if not names:
        return ()
    what = "its outputs may differ from run to run, from instance to instance and in a replay"
    return (f"it calls {', '.join(names)}, which nothing here seeds or repeats: {what}",)


def _symbols(library: Path) -> Iterator[tuple[str, bool]]:
    """Yield the dynamic symbols, and whether each is defined there; none of what is damaged."""
    content = library.read_bytes()
    if content[:6] != ELF64:
        return
    try:
        (start,) = struct.unpack_from("<Q", content, 0x28)
        size, count = struct.unpack_from("<HH", content, 0x3A)
        sections = [_SECTION.unpack_from(content, start + place * size) for place in range(count)]
        for _, kind, _, _, offset, length, link, *_ in sections:
            if kind == _DYNAMIC_SYMBOLS:
                for symbol in _SYMBOL.iter_unpack(content[offset : offset + length]):
                    first = sections[link][4] + symbol[0]
                    # The section it is in is zero where it is not defined here.
                    yield content[first : content.index(b"\0", first)].decode(errors="replace"), symbol[3] != 0
    except (struct.error, IndexError, ValueError):
        return  # the loader is the one to report what is wrong with it
