# SPDX-License-Identifier: MIT
"""An error is one line, whatever names from outside it repeats."""

import pytest

from segway_ecc.firmware_io.errors import ArmingRefusedError, SegwayEccError


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("no port is called 'a\nb'", "no port is called 'a\\nb'"),
        ("'\r\x1b[2J' \0", "'\\r\\x1b[2J' \\x00"),
        ("'\u2028', half of a pair: '\ud800'", "'\\u2028', half of a pair: '\\ud800'"),
        ("größer als 5 µs, 中", "größer als 5 µs, 中"),
        ("", ""),
    ],
)
def test_what_would_end_or_overwrite_the_line_is_shown_as_an_escape(text: str, shown: str) -> None:
    assert str(SegwayEccError(text)) == shown
    assert f"{ArmingRefusedError([text, text])}" == f"{shown}; {shown}"
