# SPDX-License-Identifier: MIT
"""What a terminal sends, made into keys."""

import pytest

from segway_ecc.hil.play.channel import Key, is_begun, keys_in


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        (b"\x1b[A\x1b[B\x1b[C\x1b[D", [Key.UP, Key.DOWN, Key.RIGHT, Key.LEFT]),
        (b"\x1bOA\x1bOB\x1bOC\x1bOD", [Key.UP, Key.DOWN, Key.RIGHT, Key.LEFT]),
        (b"wsad", [Key.UP, Key.DOWN, Key.LEFT, Key.RIGHT]),
        (b"x m", [Key.REST, Key.STOP, Key.ARM]),
        (b"ncujpbrq", [Key.DISARM, Key.CLEAR_FAULT, Key.STAND, Key.SIT, Key.PUSH, Key.CUT, Key.REPAIR, Key.QUIT]),
        (b"\x03", [Key.QUIT]),
        (b"\x04", [Key.QUIT]),
        (b"", []),
        (b".AUDLRtyz\x00\xff\n", []),
        (b"\x1b[1;5A\x1b[3~\x1b[15;2s", []),  # Ctrl-up, delete, and what ends in a letter that is a key
        (b"\x1b", [Key.STOP]),
        (b"\x1b[", [Key.STOP]),  # the rest of it never came
        (b"\x1bs", [Key.STOP, Key.DOWN]),
        (b"\x1b\x1b[A", [Key.STOP, Key.UP]),
    ],
)
def test_keys(data: bytes, keys: list[Key]) -> None:
    assert keys_in(data) == keys


def test_no_key_of_a_person_stands_for_a_live_terminal() -> None:
    assert Key.ALIVE not in {key for number in range(256) for key in keys_in(bytes((number,)))}


@pytest.mark.parametrize("data", [b"\x1b", b"w\x1b", b"\x1b[", b"\x1b[1;5", b"\x1bO", b"\x1b\x1b"])
def test_what_may_be_the_first_half_of_a_key_is_known(data: bytes) -> None:
    assert is_begun(data)


@pytest.mark.parametrize("data", [b"", b"w", b"\x1b[A", b"\x1bOA", b"\x1b[3~", b"\x1bs"])
def test_what_is_whole_is_not_waited_for(data: bytes) -> None:
    assert not is_begun(data)
