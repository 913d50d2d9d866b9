# SPDX-License-Identifier: MIT
"""Our own command in processes of their own, none of which outlives the one that starts it."""

import contextlib
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from segway_ecc.hil.errors import RigError

_END_S: Final = 10.0
_LAST_LINES: Final = 5
_OUR_COMMAND: Final = "segway_ecc.node.cli.main"


class ProcessFailedError(RigError):
    """A process ended with an error, or not in time."""


class Command:
    """One `segway-ecc` command, its messages kept in a file; it is killed when the thread that started it ends."""

    def __init__(self, process: subprocess.Popen[bytes], arguments: Sequence[str], messages: Path) -> None:
        """Use a process that `command` started."""
        self.process = process
        self._arguments = arguments
        self._messages = messages
        self._received = b""

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

    def ask(self, line: str, timeout_s: float) -> str:
        """Send a line to a command that listens, and return the line that it answers.

        Raises:
            ProcessFailedError: It ended, or did not answer in time.
        """
        if self.process.stdin is None or self.process.stdout is None:
            raise ValueError("this command does not listen")
        deadline = time.monotonic() + timeout_s
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(f"{line}\n".encode())
            self.process.stdin.flush()
        while b"\n" not in self._received:
            left = max(deadline - time.monotonic(), 0.0)
            ready = select.select([self.process.stdout], [], [], left)[0]
            data = os.read(self.process.stdout.fileno(), 4096) if ready else b""
            if not data:
                raise ProcessFailedError(self._failure(f"did not answer '{line}'"))
            self._received += data
        answer, _, self._received = self._received.partition(b"\n")
        return answer.decode()

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
        return f"'segway-ecc {' '.join(self._arguments)}' {what}: {' | '.join(lines) or 'no message'}"


@contextlib.contextmanager
def command(
    arguments: Sequence[str],
    messages: Path,
    environment: Mapping[str, str] | None = None,
    *,
    module: str = _OUR_COMMAND,
    listens: bool = False,
) -> Iterator[Command]:
    """A command that has ended when the context is left, whatever happens.

    Args:
        arguments: What follows `segway-ecc`.
        messages: Where its standard error goes.
        environment: Added to this process' own.
        module: What is run, where it is something around our command.
        listens: Whether it takes commands, with `ask`.
    """
    with messages.open("wb") as errors:
        process = subprocess.Popen(  # noqa: S603 - our own command, and no shell reads it
            [sys.executable, "-P", "-m", "segway_ecc.hil.child", str(os.getpid()), module, *arguments],
            stdin=subprocess.PIPE if listens else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=errors,
            env={**os.environ, **(environment or {})},
        )
    started = Command(process, arguments, messages)
    try:
        yield started
    finally:
        started.end()
