# SPDX-License-Identifier: MIT
"""Reading C and C++ as text: enough to find what generated code declares, without a compiler.

Everything works on code whose comments and strings are blanked, so that offsets still point into the original.
"""

import re
from collections.abc import Iterator

_QUIET = re.compile(r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'", re.DOTALL)
_DEFINITION = re.compile(
    r"(?P<result>\w+(?:\s*[*&]+)?)\s*(?<!\w)(?P<name>(?:\w+::)?\w+)\s*\((?P<arguments>[^(){};]*)\)\s*(?:const\s*)?\{"
)
_NO_FUNCTIONS = {"if", "for", "while", "switch", "return", "else", "sizeof", "catch"}


class Function:
    """A function that is defined in a text.

    Attributes:
        name: Its name, with the class in front as in `Tank::Calculate`.
        result: The type it returns.
        arguments: Its arguments, as they are written.
        start: Offset of what follows the opening brace.
        body: What stands between the braces, comments and strings blanked.
        text: The same as it is written.
    """

    __slots__ = ("arguments", "body", "name", "result", "start", "text")

    def __init__(self, match: re.Match[str], code: str, text: str) -> None:
        """Take a match of a definition's head in blanked code, and the text that was blanked."""
        self.name = match["name"]
        self.result = match["result"]
        self.arguments = " ".join(match["arguments"].split())
        self.start = match.end()
        depth, end = 1, len(code)
        for brace in re.compile(r"[{}]").finditer(code, self.start):
            depth += 1 if brace[0] == "{" else -1
            if depth == 0:
                end = brace.start()
                break
        self.body = code[self.start : end]
        self.text = text[self.start : self.start + len(self.body)]


def encoding_of(content: bytes) -> str:
    """Return the encoding of a source file: UTF-8, with or without its mark, else Latin-1, which reads every byte."""
    try:
        content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig" if content.startswith(b"\xef\xbb\xbf") else "utf-8"


def code_of(text: str, *, keep_strings: bool = False) -> str:
    """Return the text with comments (and strings) replaced by as many blanks."""

    def blank(match: re.Match[str]) -> str:
        found = match[0]
        if keep_strings and found[0] in "\"'":
            return found
        if found[0] in "\"'":
            return found[0] + " " * (len(found) - 2) + found[0]
        return re.sub(r"[^\n]", " ", found)

    return _QUIET.sub(blank, text)


def functions(code: str, text: str) -> dict[str, Function]:
    """Return the functions that a text defines, by name; `code` is the text blanked."""
    found = (Function(match, code, text) for match in _DEFINITION.finditer(code) if match["name"] not in _NO_FUNCTIONS)
    return {function.name: function for function in found if function.result not in _NO_FUNCTIONS}


def comment_at(text: str, offset: int) -> str:
    """Return the comment that follows on the same line, without its marks; empty where there is none."""
    match = re.compile(r"[ \t]*(?:/\*(.*?)\*/|//([^\n]*))", re.DOTALL).match(text, offset)
    return " ".join((match[1] or match[2] or "").split()) if match else ""


def assignments(text: str, code: str, target: str) -> Iterator[tuple[int, str, str]]:
    """Yield (index, value, comment) of each `target[index] = value;` in the text.

    Args:
        text: The code as it stands.
        code: The same with comments and strings blanked.
        target: Name of the array.
    """
    pattern = re.compile(rf"(?<![\w.]){re.escape(target)}\s*\[\s*(\d+)\s*\]\s*=(?!=)([^;]*);")
    for match in pattern.finditer(code):
        yield int(match[1]), text[match.start(2) : match.end(2)].strip(), comment_at(text, match.end())
