# SPDX-License-Identifier: MIT
"""Running the command line in this process."""

from collections.abc import Callable
from typing import NamedTuple

import pytest

from segway_ecc.node.cli.main import main


class Outcome(NamedTuple):
    """How a command went: exit code, standard output, and the lines of standard error."""

    code: int
    out: str
    errors: list[str]


@pytest.fixture
def segway_ecc(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Called with the words after `segway-ecc`."""

    def call(*words: str) -> Outcome:
        capsys.readouterr()
        try:
            code = main(words)
        except SystemExit as exited:  # how argparse ends a command
            code = exited.code if isinstance(exited.code, int) else 0
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err.splitlines())

    return call
