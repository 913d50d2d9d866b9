# SPDX-License-Identifier: MIT
"""The keys that drive a robot, and how a terminal sends them."""

import enum
import re
from typing import Final


@enum.unique
class Key(enum.StrEnum):
    """What a person presses; the values travel from the terminal's process to the loop's."""

    UP = "U"
    DOWN = "D"
    LEFT = "L"
    RIGHT = "R"
    REST = " "
    ARM = "a"
    DISARM = "d"
    STOP = "s"
    CLEAR_FAULT = "c"
    STAND = "u"
    PUSH = "p"
    BREAK_BUS = "b"
    QUIT = "q"
    ALIVE = "."
    """No key: the terminal is still alive."""


_SEQUENCES: Final = {
    **{b"\x1b[" + letter: key for letter, key in zip((b"A", b"B", b"C", b"D"), "UDRL", strict=True)},
    **{b"\x1bO" + letter: key for letter, key in zip((b"A", b"B", b"C", b"D"), "UDRL", strict=True)},
    **{key.encode(): key for key in " adscupbq"},
    b"\x03": Key.QUIT,
    b"\x04": Key.QUIT,
}
"""Cursor keys as ECMA-48 and as a terminal in application mode sends them; Ctrl-C and Ctrl-D leave."""
_WORD: Final = re.compile(rb"\x1b\[[0-?]*[ -/]*[@-~]|\x1bO.|.", re.DOTALL)
"""A control sequence (ECMA-48, 5.4), a cursor key in application mode, or a byte."""


def keys_in(data: bytes) -> list[Key]:
    """The keys in what was read from a terminal at once; what is no key is passed over.

    Nothing is kept for the next read: an escape key before the stop key must not take it for a part of a sequence.
    """
    return [Key(_SEQUENCES[word]) for word in _WORD.findall(data) if word in _SEQUENCES]
