# SPDX-License-Identifier: MIT
"""Our own command in processes of their own, none of which outlives the one that starts it; and runs side by side."""

import contextlib
import logging
import multiprocessing
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from multiprocessing.context import SpawnContext
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from segway_ecc.hil.errors import RigError

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")
_END_S: Final = 10.0
_LAST_LINES: Final = 5
_DOMAINS: Final = 101
_LOOK_S: Final = 0.2
_INTERRUPTED: Final = (-signal.SIGINT, -signal.SIGTERM, 128 + signal.SIGINT)


class ProcessFailedError(RigError):
    """A process ended with an error, or not in time.

    Attributes:
        ended_with: Its exit code; None where it was still running.
        printed: The JSON that it printed all the same; None where it did not.
    """

    ended_with: int | None = None
    printed: dict[str, Any] | None = None


class Command:
    """A program that runs, its messages kept in a file; ours is killed when the thread that started it ends."""

    def __init__(self, process: subprocess.Popen[bytes], name: str, messages: Path) -> None:
        """Use a process that `program` started."""
        self.process = process
        self._name = name
        self._messages = messages
        self._received = b""

    def result(self, timeout_s: float, partner: "Command | None" = None) -> dict[str, Any]:
        """Wait for the command, which is of no use without its partner, and decode the JSON it printed.

        Raises:
            ProcessFailedError: It ended with an error, or not in time; or its partner ended first, with an error.
            KeyboardInterrupt: It was interrupted, as this process is on Ctrl-C: both are in the terminal's group.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            left = deadline - time.monotonic()
            try:
                output, _ = self.process.communicate(timeout=max(min(left, _LOOK_S if partner else left), 0.0))
                break
            except subprocess.TimeoutExpired as error:
                if partner is not None and partner.process.poll() not in {None, 0}:
                    partner.result(_END_S)
                if left <= 0.0:
                    raise ProcessFailedError(self._failure(f"did not end within {timeout_s:g} s")) from error
        if self.process.returncode in _INTERRUPTED:
            raise KeyboardInterrupt
        if self.process.returncode != 0:
            failure = ProcessFailedError(self._failure(f"ended with exit code {self.process.returncode}"))
            failure.ended_with = self.process.returncode
            with contextlib.suppress(msgspec.DecodeError):
                failure.printed = msgspec.json.decode(output, type=dict[str, Any])
            raise failure
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
        return f"'{self._name}' {what}: {last_lines(self._messages)}"


def last_lines(messages: Path) -> str:
    """The last messages of a process, as one line."""
    lines = messages.read_text(encoding="utf-8", errors="replace").splitlines() if messages.exists() else []
    return " | ".join(lines[-_LAST_LINES:]) or "no message"


@contextlib.contextmanager
def inherited(name: str, value: str) -> Iterator[None]:
    """Have what this process starts inherit an environment variable while the context lasts."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        del os.environ[name]
        if before is not None:
            os.environ[name] = before


def own_ros_domain() -> dict[str, str]:
    """The environment in which processes find each other in ROS, and nobody else: a domain of ours on this machine.

    Linux gives the ports of domains 1 to 101 to nobody by itself (docs.ros.org, "The ROS_DOMAIN_ID").
    """
    return {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(1 + os.getpid() % _DOMAINS)}


def module_words(module: str) -> list[str]:
    """What begins the command line of a module of ours in a process that ends with this one."""
    return [sys.executable, "-P", "-m", "segway_ecc.hil.child", str(os.getpid()), module]


@contextlib.contextmanager
def program(
    words: Sequence[str],
    messages: Path,
    environment: Mapping[str, str] | None = None,
    *,
    name: str = "",
    listens: bool = False,
) -> Iterator[Command]:
    """A program that has ended when the context is left, whatever happens.

    Args:
        words: Its command line.
        messages: Where its standard error goes.
        environment: Added to this process' own.
        name: What it is called in errors.
        listens: Whether it takes commands, with `ask`.
    """
    with messages.open("wb") as errors:
        process = subprocess.Popen(  # noqa: S603 - our own programs, and no shell reads their words
            words,
            stdin=subprocess.PIPE if listens else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=errors,
            env={**os.environ, **(environment or {})},
        )
    started = Command(process, name or words[0], messages)
    try:
        yield started
    finally:
        started.end()


def command(
    arguments: Sequence[str],
    messages: Path,
    environment: Mapping[str, str] | None = None,
    *,
    module: str = "segway_ecc.node.cli.main",
    listens: bool = False,
) -> contextlib.AbstractContextManager[Command]:
    """One `segway-ecc` command, or a module around it, with these arguments; see `program`."""
    name = f"segway-ecc {' '.join(arguments)}"
    return program([*module_words(module), *arguments], messages, environment, name=name, listens=listens)


@contextlib.contextmanager
def results_of(
    run: Callable[[_Task], _Result], tasks: Sequence[_Task], jobs: int, chunk: int = 1
) -> Iterator[Iterator[_Result]]:
    """The result of each task, in their order; `run` is a function of a module, so that another process finds it.

    `jobs` processes run at a time, 1 for this one alone; each is handed `chunk` tasks at a time.
    """
    if jobs == 1:
        yield map(run, tasks)
        return
    with spawning() as processes, processes.Pool(jobs, ignore_interrupt) as pool:
        yield pool.imap(run, tasks, chunk)


def ignore_interrupt() -> None:
    """Leave Ctrl-C to the parent process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextlib.contextmanager
def quiet(*loggers: str) -> Iterator[None]:
    """Discard the messages of some loggers, which are many in a run with faults."""
    levels = {logger: logger.level for logger in map(logging.getLogger, loggers)}
    try:
        for logger in levels:
            logger.setLevel(logging.CRITICAL)
        yield
    finally:
        for logger, level in levels.items():
            logger.setLevel(level)


@contextlib.contextmanager
def spawning() -> Iterator[SpawnContext]:
    """A context whose workers begin anew, and never import from the current folder, as long as it lasts.

    `multiprocessing` starts them by `python -c`, which puts the current folder first on the path before any code of
    ours runs; there is no option for it, only the environment that they inherit.
    """
    with inherited("PYTHONSAFEPATH", "1"):
        yield multiprocessing.get_context("spawn")
