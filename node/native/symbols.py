# SPDX-License-Identifier: MIT
"""The names that a shared object exports and imports, and which of these keep its values from being repeated.

Source: System V ABI, chapters 4 and 5 (ELF).
"""

import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ELF64: Final = b"\x7fELF\x02\x01"
"""64 bits, little-endian: every machine that the project runs on."""
_DYNAMIC_SYMBOLS: Final = 11
_SYMBOL: Final = struct.Struct("<IBBHQQ")
_SECTION: Final = struct.Struct("<IIQQQQIIQQ")
_UNREPEATABLE: Final = re.compile(
    r"(s?rand|s?random|initstate|setstate|[dlm]rand48|srand48|seed48|lcong48|getrandom|getentropy|arc4random\w*"
    r"|time|clock|times|ftime|gettimeofday|clock_gettime|timespec_get)$|_ZNSt(13random_device)|_ZNSt6(chrono)\w*3nowEv"
)
"""Random numbers that all of a process draw from, or that nobody can draw again, and clocks; of C, POSIX and C++."""


def exported(library: Path) -> frozenset[str]:
    """Return the names that a library exports; none where it is not 64-bit little-endian ELF."""
    return frozenset(name for name, is_defined in _symbols(library) if is_defined)


def repeatability_warnings(library: Path) -> tuple[str, ...]:
    """Return a line where a library calls what gives other values in each run, instance or start; else nothing."""
    found = (_UNREPEATABLE.match(name) for name, is_defined in _symbols(library) if not is_defined)
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
