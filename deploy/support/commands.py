# SPDX-License-Identifier: MIT
"""Asking other programs, for a bounded time and a bounded answer."""

import shutil
import subprocess
from collections.abc import Sequence
from typing import Final

_PATIENCE_S: Final = 20.0
_LONGEST: Final = 8 * 1024 * 1024


class NoAnswerError(Exception):
    """A program is not here, failed, or took too long; the text has the reason."""


def answer_of(words: Sequence[str], patience_s: float = _PATIENCE_S) -> str:
    """What a program prints, which `words` name with its arguments; it may take `patience_s`, s.

    Raises:
        NoAnswerError: It is not here, fails, or takes too long.
    """
    program = shutil.which(words[0])
    if program is None:
        raise NoAnswerError(f"there is no program {words[0]} here")
    try:
        ended = subprocess.run(  # noqa: S603 - the words are ours
            [program, *words[1:]], stdin=subprocess.DEVNULL, capture_output=True, check=False, timeout=patience_s
        )
    except subprocess.TimeoutExpired:
        raise NoAnswerError(f"{words[0]} gave no answer within {patience_s:g} s") from None
    except OSError as error:
        raise NoAnswerError(f"{words[0]}: {error.strerror}") from None
    if ended.returncode:
        lines = ended.stderr.decode("utf-8", "replace").strip().splitlines() or [f"exit code {ended.returncode}"]
        raise NoAnswerError(f"{words[0]}: {lines[-1]}")
    return ended.stdout[-_LONGEST:].decode("utf-8", "replace")
