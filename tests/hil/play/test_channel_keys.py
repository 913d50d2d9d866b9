# SPDX-License-Identifier: MIT
"""What a terminal sends, made into keys."""

import pytest

from segway_ecc.hil.play.channel import Key, keys_in


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        (b"\x1b[A\x1b[B\x1b[C\x1b[D", [Key.UP, Key.DOWN, Key.RIGHT, Key.LEFT]),
        (b"\x1bOA\x1bOB\x1bOC\x1bOD", [Key.UP, Key.DOWN, Key.RIGHT, Key.LEFT]),
        (b" a", [Key.REST, Key.ARM]),
        (b"dscpbq", [Key.DISARM, Key.STOP, Key.CLEAR_FAULT, Key.PUSH, Key.BREAK_BUS, Key.QUIT]),
        (b"\x03", [Key.QUIT]),
        (b"\x04", [Key.QUIT]),
        (b"", []),
        (b".AUDLRxyz\x00\xff\n", []),
        (b"\x1b[1;5A\x1b[3~\x1b[15;2s", []),  # Ctrl-up, delete, and what ends in a letter that is a key
        (b"\x1b[", []),
        (b"\x1b", []),
        (b"\x1bs", [Key.STOP]),
        (b"\x1b\x1b[A", [Key.UP]),
    ],
)
def test_keys(data: bytes, keys: list[Key]) -> None:
    assert keys_in(data) == keys


def test_no_key_of_a_person_stands_for_a_live_terminal() -> None:
    assert Key.ALIVE not in {key for number in range(256) for key in keys_in(bytes((number,)))}
