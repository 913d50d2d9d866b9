# SPDX-License-Identifier: MIT
import threading
import time
from collections.abc import Callable

import pytest

from segway_ecc.firmware_io.links import can_interfaces
from segway_ecc.firmware_io.links.can_interfaces import UNKNOWN, InterfaceState, InterfaceWatch
from segway_ecc.firmware_io.links.link import LinkState
from tests.patience import PATIENCE_S

PASSIVE = InterfaceState("can", is_up=True, state=LinkState.PASSIVE)


class Kernel:
    """Answers for one interface; threads that an earlier test left behind ask for others."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.asked = 0
        self.failure: Exception | None = None

    def answer(self, name: str) -> InterfaceState:
        if name == self.name:
            self.asked += 1
        if self.failure is not None:
            raise self.failure
        return PASSIVE


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Kernel:
    kernel = Kernel(request.node.name)
    monkeypatch.setattr(can_interfaces, "read_interface_state", kernel.answer)
    return kernel


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "another thread did not do its part"
        time.sleep(0.001)


def test_the_answer_to_one_look_is_seen_at_a_later_one(kernel: Kernel) -> None:
    watch = InterfaceWatch(kernel.name)
    assert not watch.look(0)
    assert watch.state == UNKNOWN
    until(lambda: watch.look(0))
    assert watch.state == PASSIVE
    assert watch.as_text() == {"interface": str(PASSIVE)}


def test_an_answer_that_is_older_than_the_last_error_frame_is_kept_and_is_no_news(kernel: Kernel) -> None:
    watch = InterfaceWatch(kernel.name)
    watch.look(3)
    until(lambda: kernel.asked == 1)
    heard: list[bool] = []

    def has_come() -> bool:
        heard.append(watch.look(4))
        return watch.state == PASSIVE

    until(has_come)
    assert not any(heard)
    until(lambda: watch.look(4))


def test_one_question_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    gate, asked = threading.Event(), list[str]()

    def answer(name: str) -> InterfaceState:
        asked.append(name)
        assert gate.wait(PATIENCE_S)
        return PASSIVE

    monkeypatch.setattr(can_interfaces, "read_interface_state", answer)
    watch = InterfaceWatch("slow")
    assert [watch.look(0) for _ in range(20)] == [False] * 20
    until(lambda: "slow" in asked)
    gate.set()
    until(lambda: watch.state == PASSIVE or watch.look(0))
    assert asked.count("slow") <= 2


def test_a_new_beginning_forgets_what_was_asked_before(kernel: Kernel) -> None:
    watch = InterfaceWatch(kernel.name)
    watch.look(0)
    until(lambda: kernel.asked == 1)
    watch.begin(UNKNOWN)
    assert not watch.look(0)
    assert watch.state == UNKNOWN


def test_a_failure_to_ask_is_no_answer(kernel: Kernel) -> None:
    kernel.failure = ArithmeticError("odd")
    watch = InterfaceWatch(kernel.name)
    until(lambda: watch.look(0) or kernel.asked > 2)
    assert watch.state == UNKNOWN


def test_a_bus_that_is_no_network_interface_is_not_asked_about() -> None:
    watch = InterfaceWatch(None)
    assert not watch.look(0)
    assert (watch.read(), watch.as_text()) == (UNKNOWN, {})
