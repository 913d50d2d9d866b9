# SPDX-License-Identifier: MIT
"""The clock that measures CPU time between waits."""

import time

import pytest

from segway_ecc.hil.growth.cost import MeteredClock


class Waits:
    """Counts waits; a wait takes CPU time, which must not be counted."""

    def __init__(self) -> None:
        self.deadlines: list[int] = []

    def now_ns(self) -> int:
        return 7

    def wall_ns(self) -> int:
        return 8

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.deadlines.append(deadline_ns)


def test_what_lies_between_two_waits_is_counted_and_waits_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    read = iter((100, 250, 1000, 1300))  # end of the first wait; begin and end of the second; begin of the third
    monkeypatch.setattr(time, "thread_time_ns", lambda: next(read, 9999))
    behind = Waits()
    clock = MeteredClock(behind)
    for deadline in (1, 2, 3):
        clock.sleep_until_ns(deadline)
    assert clock.taken_ns == [150, 300]
    assert behind.deadlines == [1, 2, 3]
    assert (clock.now_ns(), clock.wall_ns()) == (7, 8)
