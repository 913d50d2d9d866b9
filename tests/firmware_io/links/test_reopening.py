# SPDX-License-Identifier: MIT
import contextlib
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.reopening import RETRY_NS, BackgroundTask, Recovery
from tests.patience import PATIENCE_S


def until(condition: Callable[[], bool]) -> None:
    """Wait for what another thread is sure to do."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "another thread did not do its part"
        time.sleep(0.001)


class Opener:
    """Opens things named by number, when it is let."""

    def __init__(self) -> None:
        self.gate = threading.Event()
        self.gate.set()
        self.opened: list[int] = []
        self.closed: list[int] = []
        self.failure: Exception | None = None
        self.attempts = 0
        self.threads: set[int] = set()

    def open(self) -> int:
        self.attempts += 1
        self.threads.add(threading.get_ident())
        assert self.gate.wait(PATIENCE_S)
        if self.failure is not None:
            raise self.failure
        self.opened.append(self.attempts)
        return self.attempts


class Clock:
    def __init__(self) -> None:
        self.now_ns = 0

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture
def opener() -> Iterator[Opener]:
    opener = Opener()
    yield opener
    opener.gate.set()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def recovery(opener: Opener, clock: Clock) -> Recovery[int]:
    return Recovery("bus", opener.open, opener.closed.append, clock)


def _attempt(recovery: Recovery[int]) -> int | None:
    """Look for a port that is lost."""
    recovery.lose(lambda: None, "gone")
    with contextlib.suppress(LinkLostError):
        return recovery.regain()
    return None


def _poll(recovery: Recovery[int]) -> int:
    found: list[int] = []

    def is_there() -> bool:
        result = _attempt(recovery)
        found.extend([] if result is None else [result])
        return bool(found)

    until(is_there)
    return found[0]


def test_it_is_opened_in_another_thread_and_handed_over_once(
    recovery: Recovery[int], opener: Opener, clock: Clock
) -> None:
    assert _attempt(recovery) is None
    assert _poll(recovery) == 1
    assert _attempt(recovery) is None
    assert opener.threads.isdisjoint({threading.get_ident()})
    assert (opener.attempts, opener.closed, recovery.failure) == (1, [], "")
    clock.now_ns += RETRY_NS
    recovery.end()


def test_one_attempt_at_a_time_and_nobody_waits_for_it(recovery: Recovery[int], opener: Opener, clock: Clock) -> None:
    opener.gate.clear()
    for _ in range(50):
        assert _attempt(recovery) is None
        clock.now_ns += RETRY_NS
    until(lambda: opener.attempts > 0)
    opener.gate.set()
    assert _poll(recovery) == opener.attempts == 1


def test_attempts_keep_their_distance(recovery: Recovery[int], opener: Opener, clock: Clock) -> None:
    opener.failure = OSError("not yet")
    assert RETRY_NS == 100_000_000
    _attempt(recovery)
    until(lambda: _attempt(recovery) is None and recovery.failure == "not yet")
    clock.now_ns += RETRY_NS - 1
    assert [_attempt(recovery) for _ in range(10)] == [None] * 10
    assert recovery._attempt is None, "an attempt counts from when it is begun, not from when its thread runs"
    assert opener.attempts == 1

    opener.failure = None
    clock.now_ns += 1
    assert _poll(recovery) == opener.attempts == 2
    assert recovery.failure == "", "it is open again"


def test_what_is_opened_after_the_end_is_closed(recovery: Recovery[int], opener: Opener) -> None:
    opener.gate.clear()
    _attempt(recovery)
    until(lambda: opener.attempts == 1)
    recovery.end()
    recovery.end()
    assert opener.closed == []
    opener.gate.set()
    until(lambda: opener.closed == [1])


def test_what_was_opened_and_not_fetched_is_closed(recovery: Recovery[int], opener: Opener) -> None:
    _attempt(recovery)
    until(lambda: opener.opened == [1])
    recovery.end()
    until(lambda: opener.closed == [1])
    assert _attempt(recovery) is None


def test_a_failure_is_forgotten_with_the_end(recovery: Recovery[int], opener: Opener) -> None:
    opener.failure = OSError("not yet")
    _attempt(recovery)
    until(lambda: _attempt(recovery) is None and bool(recovery.failure))
    recovery.end()
    assert recovery.failure == ""


def test_however_end_and_outcome_meet_it_is_closed_exactly_once() -> None:
    closed: list[int] = []
    for number in range(300):
        task = BackgroundTask(lambda number=number: number, closed.append)  # type: ignore[misc]
        task.abandon()
    until(lambda: len(closed) == 300)
    assert sorted(closed) == list(range(300))


def test_whatever_work_raises_is_its_outcome() -> None:
    def fail() -> int:
        raise ArithmeticError("odd")

    task, outcomes = BackgroundTask(fail), list[object]()

    def is_over() -> bool:
        outcome = task.take_outcome()
        outcomes.extend([] if outcome is None else [outcome])
        return bool(outcomes)

    until(is_over)
    assert isinstance(outcomes[0], ArithmeticError)
    task.abandon()
