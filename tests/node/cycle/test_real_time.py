import os

import pytest

from node.cycle.real_time import request_real_time


def test_what_is_granted_is_asked_for_this_thread_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int, int]] = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda pid, policy, p: asked.append((pid, policy, p.sched_priority)))
    assert request_real_time(42) is None
    assert asked == [(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 42)]


def test_what_is_not_permitted_is_told_with_its_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert request_real_time() == (
        "no real-time priority (Operation not permitted): other programs can make cycles late; "
        "run as root, or raise the limit: ulimit -r"
    )
