import os

import pytest

from node.cycle.real_time import real_time_priority

REAL_TIME = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int, int]]:
    """What the kernel was asked for, granted."""
    asked: list[tuple[int, int, int]] = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda pid, policy, p: asked.append((pid, policy, p.sched_priority)))
    return asked


def test_what_is_granted_is_asked_for_this_thread_alone_and_given_back(asked: list[tuple[int, int, int]]) -> None:
    before = (0, os.sched_getscheduler(0) | os.SCHED_RESET_ON_FORK, os.sched_getparam(0).sched_priority)
    with real_time_priority(42) as refusal:
        assert refusal is None
        assert asked == [(0, REAL_TIME, 42)]
    assert asked == [(0, REAL_TIME, 42), before]


def test_it_is_given_back_after_a_failure_too(asked: list[tuple[int, int, int]]) -> None:
    def fail() -> None:
        with real_time_priority():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert len(asked) == 2


def test_what_is_not_permitted_is_told_with_its_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with real_time_priority() as refusal:
        assert refusal == (
            "no real-time priority (Operation not permitted): other programs can make cycles late; "
            "run as root, or raise the limit: ulimit -r"
        )


@pytest.mark.parametrize("policy", [os.SCHED_FIFO, os.SCHED_RR, REAL_TIME])
def test_what_a_service_was_given_is_kept(
    asked: list[tuple[int, int, int]], monkeypatch: pytest.MonkeyPatch, policy: int
) -> None:
    monkeypatch.setattr(os, "sched_getscheduler", lambda _: policy)
    with real_time_priority(42) as refusal:
        assert refusal is None
    assert asked == []
