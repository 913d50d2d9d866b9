# SPDX-License-Identifier: MIT
"""A wall clock that steps, as one process reads it."""

import os
import signal
import time
from collections.abc import Iterator

import pytest

from segway_ecc.firmware_io.clock import RealClock, wall_ns
from segway_ecc.hil.drill.stepped_clock import AHEAD, BACK, install

HOUR_NS = 3600 * 10**9
SLACK_NS = 600 * 10**9


@pytest.fixture
def stepped() -> Iterator[None]:
    handlers = {number: signal.getsignal(number) for number in (AHEAD, BACK)}
    before = install()
    yield
    time.clock_gettime_ns = before
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("stepped")
@pytest.mark.parametrize(
    ("numbers", "hours"), [([], 0), ([AHEAD], 1), ([BACK], -1), ([AHEAD, AHEAD, BACK], 1), ([AHEAD, AHEAD], 2)]
)
def test_every_reader_of_the_wall_clock_is_stepped_and_the_monotonic_clock_is_not(
    numbers: list[signal.Signals], hours: int
) -> None:
    wall, monotonic, raw = RealClock().wall_ns(), RealClock().now_ns(), time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    for number in numbers:
        os.kill(os.getpid(), number)

    assert abs(RealClock().wall_ns() - wall - hours * HOUR_NS) < SLACK_NS
    assert abs(wall_ns() - wall - hours * HOUR_NS) < SLACK_NS
    assert 0 <= RealClock().now_ns() - monotonic < SLACK_NS
    assert 0 <= time.clock_gettime_ns(time.CLOCK_MONOTONIC) - raw < SLACK_NS
