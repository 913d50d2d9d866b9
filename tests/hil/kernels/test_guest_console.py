# SPDX-License-Identifier: MIT
import itertools
import os
import time
from collections.abc import Iterator
from typing import BinaryIO

import pytest

from segway_ecc.hil.kernels import guest
from segway_ecc.hil.kernels.guest import Console
from tests.patience import PATIENCE_S


class Pipe:
    """A guest's console: what is written to `guest` is read from `host`."""

    def __init__(self) -> None:
        read, write = os.pipe()
        self.host: BinaryIO = os.fdopen(read, "rb", buffering=0)
        self.guest: BinaryIO = os.fdopen(write, "wb", buffering=0)


@pytest.fixture
def pipe() -> Iterator[Pipe]:
    ends = Pipe()
    yield ends
    ends.host.close()
    ends.guest.close()


def test_a_kernel_that_panicked_is_not_waited_for(pipe: Pipe, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guest, "_PANIC_TAKES_S", 0.1)
    screen = Console("token", None, time.monotonic)
    pipe.guest.write(b"token begin\r\nhalf a line[    4.126962] Kernel panic - not syncing: why\r\n and where\r\n")

    assert screen.follow(pipe.host, PATIENCE_S)
    assert screen.last_lines().endswith("Kernel panic - not syncing: why\n   and where")


def test_a_command_that_speaks_of_panic_is_waited_for(pipe: Pipe) -> None:
    seconds = itertools.count()
    screen = Console("token", None, lambda: 0.05 * next(seconds))
    pipe.guest.write(b"token begin\r\nKernel panic - not syncing\r\n")

    assert not screen.follow(pipe.host, 0.1)
    assert screen.output == ["Kernel panic - not syncing\n"]


def test_a_silent_guest_runs_out_of_time(pipe: Pipe) -> None:
    assert not Console("token", None, time.monotonic).follow(pipe.host, 0.05)
