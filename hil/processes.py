"""Our own command in processes of their own."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from hil.errors import RigError

_END_S: Final = 10.0
_LAST_LINES: Final = 5


class ProcessFailedError(RigError):
    """A process ended with an error, or not in time."""


class Command:
    """One `segway-ecc` command, its messages kept in a file."""

    def __init__(self, arguments: Sequence[str], messages: Path, environment: Mapping[str, str]) -> None:
        """Start the command.

        Args:
            arguments: What follows `segway-ecc`.
            messages: Where its standard error goes.
            environment: Added to this process' own.
        """
        self._arguments = list(arguments)
        self._messages = messages
        with messages.open("wb") as errors:
            self.process = subprocess.Popen(  # noqa: S603 - our own command, and no shell reads it
                [sys.executable, "-m", "node.cli.main", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=errors,
                env={**os.environ, **environment},
            )

    def result(self, timeout_s: float) -> dict[str, Any]:
        """Wait for the command and decode the JSON it printed.

        Raises:
            ProcessFailedError: It ended with an error, or not in time.
        """
        try:
            output, _ = self.process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired as error:
            raise ProcessFailedError(self._failure(f"did not end within {timeout_s:g} s")) from error
        if self.process.returncode != 0:
            raise ProcessFailedError(self._failure(f"ended with exit code {self.process.returncode}"))
        return msgspec.json.decode(output, type=dict[str, Any])

    def end(self) -> None:
        """End the command, if it still runs, and wait for it."""
        if self.process.poll() is None:
            self.process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.communicate(timeout=_END_S)
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()

    def _failure(self, what: str) -> str:
        lines = self._messages.read_text(encoding="utf-8", errors="replace").splitlines()[-_LAST_LINES:]
        return f"'segway-ecc {' '.join(self._arguments)}' {what}: {' | '.join(lines) or 'it said nothing'}"


@contextlib.contextmanager
def command(
    arguments: Sequence[str], messages: Path, environment: Mapping[str, str] | None = None
) -> Iterator[Command]:
    """A command that has ended when the context is left, whatever happens."""
    started = Command(arguments, messages, environment or {})
    try:
        yield started
    finally:
        started.end()
