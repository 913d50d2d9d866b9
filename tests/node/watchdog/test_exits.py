# SPDX-License-Identifier: MIT
"""Ends with status 0 are asked for, by a process and by what it starts; all others are not."""

import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from segway_ecc.node.watchdog.exits import Exits, receive_exits
from tests.patience import PATIENCE_S

ASKS = """
import ctypes, os, signal, socket, subprocess, sys
from segway_ecc.node.watchdog.exits import hand_over_exits
with socket.socket(fileno=int(sys.argv[1])) as sink:
    hand_over_exits(sink)
"""


@contextmanager
def asking(program: str) -> Iterator[tuple["subprocess.Popen[bytes]", Exits]]:
    """A process whose end is asked for, and where."""
    ours, theirs = socket.socketpair()
    with theirs:
        words = [sys.executable, "-P", "-c", f"{ASKS}\n{program}", str(theirs.fileno())]
        process = subprocess.Popen(words, pass_fds=(theirs.fileno(),))
    with process:
        exits = receive_exits(ours.detach())
        assert exits is not None
        yield process, exits
        process.kill()
        os.close(exits.descriptor)


def answer_once(exits: Exits, *, is_allowed: bool) -> list[int]:
    """Wait until one asks; returns who did."""
    asked: list[int] = []

    def keep(thread: int) -> bool:
        asked.append(thread)
        return is_allowed

    assert select.select([exits.descriptor], [], [], PATIENCE_S)[0]
    assert exits.answer(keep) == is_allowed
    return asked


@pytest.mark.parametrize("program", ["sys.exit(0)", "os._exit(256)", "os.execv('/bin/true', ['true'])"])
def test_an_end_with_status_0_waits_until_it_is_allowed(program: str) -> None:
    with asking(program) as (process, exits):
        assert answer_once(exits, is_allowed=True) == [process.pid]
        assert process.wait(PATIENCE_S) == 0


def test_an_end_that_is_refused_waits_for_a_signal() -> None:
    with asking("os._exit(0)") as (process, exits):
        assert answer_once(exits, is_allowed=False) == [process.pid]
        process.send_signal(signal.SIGABRT)
        assert process.wait(PATIENCE_S) == -signal.SIGABRT


@pytest.mark.parametrize(("program", "code"), [("os._exit(3)", 3), ("os.abort()", -signal.SIGABRT)])
def test_any_other_end_is_not_asked_for(program: str, code: int) -> None:
    with asking(program) as (process, exits):
        assert process.wait(PATIENCE_S) == code
        assert exits.answer(lambda _thread: pytest.fail("nobody asks"))


def test_a_process_that_it_starts_asks_by_its_own_number() -> None:
    with asking("os._exit(7 + subprocess.run(['/bin/true']).returncode)") as (process, exits):
        assert answer_once(exits, is_allowed=True) != [process.pid]
        assert process.wait(PATIENCE_S) == 7


def test_all_who_ask_later_are_allowed_until_nobody_is_left() -> None:
    with asking("os._exit(subprocess.run(['/bin/true']).returncode)") as (process, exits):
        exits.answer_to_the_end()
        assert process.wait(PATIENCE_S) == 0
        _, status = os.waitpid(-1, 0)  # the process that answered
        assert status == 0


def test_where_nothing_was_handed_over_there_is_nothing_to_answer() -> None:
    ours, theirs = socket.socketpair()
    theirs.close()
    assert receive_exits(ours.detach()) is None
