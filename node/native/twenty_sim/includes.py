# SPDX-License-Identifier: MIT
"""Headers that a folder lacks, made on our side of the include path.

Folders come from file systems that ignore case, are moved about, and are copied in part. What
is there under another spelling or in another place is forwarded to; what only declares functions that the code may
never call is left empty, and what it calls all the same is then named by the linker.
"""

import posixpath
import re
from typing import Final

from segway_ecc.node.native.twenty_sim.c_text import code_of
from segway_ecc.node.native.twenty_sim.files import Folder

TREE: Final = "model"
"""Where the user's files lie in the folder that is compiled."""
_INCLUDE: Final = re.compile(r"^[ \t]*#[ \t]*include[ \t]*([\"<])([^\">\n]+)[\">]", re.MULTILINE)
_MAY_BE_EMPTY: Final = ("motionprofiles", "eulerangles", "matrix", "inverse", "integ", "funcs")


def supplied_headers(folder: Folder) -> dict[str, str]:
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
