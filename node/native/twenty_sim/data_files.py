# SPDX-License-Identifier: MIT
"""Data files that a model's code reads: found before it is compiled, and compiled in.

Generated code names them as 20-sim did, often with a path of the Windows machine that generated it, and opens them
below whatever folder the process happens to run in. So their content goes into the shared object, where the shim's
`fopen` finds it by the last part of the name.
"""

import re
from collections.abc import Mapping

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.twenty_sim.c_text import code_of
from segway_ecc.node.native.twenty_sim.parts import Parts


def read_data(parts: Parts) -> dict[str, bytes]:
    """Return the content of each data file that the code names in a call, by its name without folders.

    Raises:
        ModelError: A file is not in the folder, or cannot be read.
    """
    found: dict[str, bytes] = {}
    prefix = next((name.removesuffix("Double") for name in parts.types if name.endswith("Double")), "")
    call = re.compile(rf"\b(?:{re.escape(prefix)}(?:Data|Table\w*)|fopen)\s*\(\s*\"((?:\\.|[^\"\\\n])+)\"(?!\s*\"?w)")
    for source in parts.folder.sources:
        for written in call.findall(code_of(source.text, keep_strings=True)):
            name = re.split(r"[\\/]+", written)[-1]
            place = parts.folder.data.get(name.lower())
            if place is None:
                where = f"{source.name} in {parts.folder.path}"
                raise ModelError(f"{where} reads {name}, which is not in the folder: add it")
            try:
                found[name] = place.read_bytes()
            except OSError as error:
                raise ModelError(f"cannot read {place}, which {source.name} reads: {error}") from error
    return found


def embedded(data: Mapping[str, bytes]) -> list[str]:
    """Return the lines of C that hold the files."""
    if not data:
        return []
    rows = ", ".join(f'{{"{name}", ecc_file_{index}, {len(data[name])}}}' for index, name in enumerate(data))
    table = "static const struct { const char *name; const unsigned char *content; unsigned long size; } ecc_files[]"
    contents = [
        f"static const unsigned char ecc_file_{index}[] = {{{', '.join(map(str, [*content, 0]))}}};"
        for index, content in enumerate(data.values())
    ]
    return [*contents, f"#define ECC_FILES {len(data)}", f"{table} = {{{rows}}};"]
