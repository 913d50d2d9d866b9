# SPDX-License-Identifier: MIT
"""A person at a terminal."""

import io
import os
from collections.abc import Iterator

import pytest

from segway_ecc.hil.commission.person import Answer, Task, TerminalPerson

Ends = tuple[int, int]


@pytest.fixture
def ends() -> Iterator[Ends]:
    """What is read, and where it is typed."""
    reader, writer = os.pipe()
    yield reader, writer
    os.close(reader)


@pytest.mark.parametrize(
    ("typed", "answer"),
    [(b"\n", Answer.DONE), (b"n\n", Answer.CANNOT), (b"No\n", Answer.CANNOT), (b"y\n", Answer.DONE), (b"n", None)],
)
def test_a_line_answers(ends: Ends, typed: bytes, answer: Answer | None) -> None:
    out = io.StringIO()
    person = TerminalPerson(ends[0], out)
    person.begin(Task.LIFT)
    assert person.answer() is None

    os.write(ends[1], typed)

    assert person.answer() is answer
    assert str(Task.LIFT) in out.getvalue()
    os.close(ends[1])


def test_what_was_typed_before_the_question_answers_nothing(ends: Ends) -> None:
    person = TerminalPerson(ends[0], io.StringIO())
    os.write(ends[1], b"\n\n")
    person.begin(Task.KEEP_CLEAR)
    assert person.answer() is None
    os.close(ends[1])


def test_terminal_that_is_gone_can_do_nothing(ends: Ends) -> None:
    person = TerminalPerson(ends[0], io.StringIO())
    os.close(ends[1])
    person.begin(Task.KEEP_CLEAR)
    assert person.answer() is Answer.CANNOT
