# SPDX-License-Identifier: MIT
"""The page says which call into the model is going on."""

import mmap
import os
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from segway_ecc import Method, SectionedModel, Variable, Write
from segway_ecc.node.cycle.state import take_snapshot
from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.undo import keep_state
from segway_ecc.node.model.writer import VariableWriter
from segway_ecc.node.watchdog.page import MOST_INPUTS, Call, CallPage
from segway_ecc.node.watchdog.watched_model import WatchedModel
from segway_ecc.node.watchdog.watched_model import watched as watch


class Tank(SectionedModel):
    name, step_size, method = "Tank", 0.1, Method.EULER
    inputs = (Variable("inflow"), Variable("valve"))
    outputs = (Variable("level"),)
    parameters = (Variable("area", value=2.0, write=Write.NOW),)
    look: Callable[[], None] = staticmethod(lambda: None)

    def static(self) -> None:
        self.look()

    def output(self) -> tuple[float, ...]:
        self.look()
        return (1.0,)

    def final(self) -> None:
        self.look()


@pytest.fixture
def page() -> CallPage:
    descriptor = os.memfd_create("page")
    os.ftruncate(descriptor, mmap.PAGESIZE)
    found = CallPage(descriptor, 2)
    os.close(descriptor)
    return found


@pytest.fixture
def watched(page: CallPage) -> WatchedModel:
    """A model of which the page is looked at in the middle of each call."""
    tank = Tank()
    seen: list[Any] = []
    tank.look = lambda: seen.append((*page.look(), page.inputs()))
    model = WatchedModel(tank, page, now_ns=lambda: 77)
    model.counter = SimpleNamespace(cycle=5)
    model.seen = seen  # type: ignore[attr-defined]
    return model


def test_each_call_is_on_the_page_while_it_lasts(watched: Any, page: CallPage) -> None:
    watched.initialize([0.5, 1.0])
    watched.step([0.25, -1.0])
    watched.terminate()
    assert watched.seen == [
        (Call.INITIALIZE, 5, 77, (0.5, 1.0)),
        (Call.INITIALIZE, 5, 77, (0.5, 1.0)),
        (Call.STEP, 5, 77, (0.25, -1.0)),
        (Call.TERMINATE, 5, 77, (0.25, -1.0)),
    ]
    assert page.look().call is Call.NONE


@pytest.mark.parametrize(
    ("call", "given"),
    [("initialize", ([0, 0],)), ("step", ([0, 0],)), ("terminate", ()), ("read", ("x",)), ("write", ("x", 1.0))],
)
def test_a_call_that_raises_is_over(watched: Any, page: CallPage, call: str, given: Sequence[Any]) -> None:
    def fail() -> None:
        raise ModelError

    watched.watched_model.look = fail
    with pytest.raises(ModelError):
        getattr(watched, call)(*given)
    assert page.look().call is Call.NONE


def test_it_is_the_model_in_all_else(watched: Any) -> None:
    tank = watched.watched_model
    names = ("name", "step_size", "inputs", "outputs", "parameters", "states", "stopped")
    assert all(getattr(watched, name) == getattr(tank, name) for name in names)
    watched.write("area", 3.0)
    assert watched.read("area") == 3.0


class OwnState(Tank):
    """A model that gives and takes its state itself."""

    held = b"none"

    def save_state(self) -> bytes:
        self.look()
        return self.held

    def restore_state(self, data: bytes) -> None:
        self.look()
        self.held = data


def test_its_state_is_the_models(page: CallPage) -> None:
    tank = Tank()
    assert take_snapshot(object, watch(tank, page), 1, 0).model == take_snapshot(object, tank, 1, 0).model != b""


def test_a_state_that_the_model_keeps_itself_is_asked_for_under_watch(page: CallPage) -> None:
    tank, seen = OwnState(), []
    tank.look = lambda: seen.append(page.look().call)
    model: Any = watch(tank, page)
    put_back = keep_state(model)
    tank.held = b"other"
    put_back()
    assert (seen, tank.held) == ([Call.SAVE, Call.RESTORE], b"none")
    assert page.look().call is Call.NONE


@pytest.mark.parametrize("kind", [Tank, OwnState])
def test_a_write_is_tried_and_taken_back_as_without_a_watch(page: CallPage, kind: type[Tank]) -> None:
    model = watch(kind(), page)
    model.initialize([0.0, 0.0])
    writer = VariableWriter(model, {variable.name: variable for variable in model.parameters})
    assert writer.write([("area", 3.0)], [0.0, 0.0]) == ""
    assert model.read("area") == 3.0
    assert "only finite values" in writer.write([("area", float("nan"))], [0.0, 0.0])


def test_of_more_inputs_than_a_page_holds_the_first_are_kept(page: CallPage) -> None:
    page.resize(10_000)
    page.enter_with(Call.STEP, 1, 1, [float(place) for place in range(10_000)])
    assert page.inputs() == tuple(map(float, range(MOST_INPUTS)))


def test_a_page_that_the_model_has_overwritten_is_read_as_no_call(page: CallPage) -> None:
    page._map[:] = b"\xff" * mmap.PAGESIZE
    assert page.look().call is Call.NONE


def test_what_a_step_gives_is_taken_while_it_is_watched(page: CallPage) -> None:
    class Slow:
        name, step_size, inputs, outputs, parameters, states = "slow", 0.1, (), (), (), ()

        def __init__(self) -> None:
            self.seen: list[Call] = []

        @property
        def stopped(self) -> bool:
            self.seen.append(page.look().call)
            return True

        def step(self, u: Sequence[float]) -> Any:
            for each in u:
                self.seen.append(page.look().call)
                yield each

        def read(self, name: str) -> Any:
            return SimpleNamespace(__float__=None) if name == "x" else 3

    slow: Any = Slow()
    model = watch(slow, page)
    assert (model.step([1.0, 2.0]), model.stopped, model.read("y")) == ([1.0, 2.0], True, 3.0)
    assert slow.seen == [Call.STEP] * 3
    assert page.look().call is Call.NONE
    with pytest.raises(TypeError):
        model.read("x")
