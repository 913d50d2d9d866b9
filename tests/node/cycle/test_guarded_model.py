# SPDX-License-Identifier: MIT
"""What a model may raise, and how it is reported."""

import signal
from collections.abc import Callable, Iterator

import pytest

from segway_ecc.node.cycle.guarded_model import GuardedModel
from segway_ecc.node.errors import ModelFailedError
from segway_ecc.node.models.cart import Cart


class MuteError(ValueError):
    """An error that cannot be shown."""

    def __str__(self) -> str:
        raise RuntimeError("not even this")


@pytest.fixture
def handled() -> Iterator[None]:
    """SIGINT is somebody's, as in a run."""
    old = signal.signal(signal.SIGINT, lambda _number, _frame: None)
    yield
    signal.signal(signal.SIGINT, old)


def raising(error: BaseException) -> Callable[..., list[float]]:
    def call(*_: object) -> list[float]:
        raise error

    return call


def failing(call: str, error: BaseException) -> GuardedModel:
    model = Cart()
    setattr(model, call, raising(error))
    guarded = GuardedModel(model)
    guarded.cycle = 7
    return guarded


@pytest.mark.parametrize(
    ("call", "arguments", "when"),
    [
        ("initialize", ([],), "in its initial equations"),
        ("step", ([],), "while running"),
        ("read", ("X",), "when 'X' was read"),
        ("write", ("LinearSetpoint", 1.0), "when 'LinearSetpoint' was set to 1.0"),
    ],
)
def test_the_reason_names_model_cycle_call_cause_and_place(call: str, arguments: tuple[object, ...], when: str) -> None:
    model = failing(call, ZeroDivisionError("flat wheel"))
    text = rf"^model 'cart' failed in cycle 7 {when}: ZeroDivisionError: flat wheel \(.*test_guarded_model\.py:\d+\)$"
    with pytest.raises(ModelFailedError, match=text) as caught:
        getattr(model, call)(*arguments)
    assert model.failure == str(caught.value)


def test_final_equations_run_only_where_the_initial_ones_were_begun() -> None:
    model = failing("terminate", ValueError("no end"))
    model.terminate()
    model.initialize([])
    with pytest.raises(ModelFailedError, match=r"failed in cycle 7 in its final equations: ValueError: no end"):
        model.terminate()


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (MuteError(), "MuteError: it cannot be shown ("),
        (ValueError("two\n  lines"), "ValueError: two lines ("),
        (ValueError("x" * 10_000), f"ValueError: {'x' * 497}... ("),
        (StopIteration(), "StopIteration ("),
    ],
)
def test_a_reason_is_one_short_line(error: BaseException, text: str) -> None:
    with pytest.raises(ModelFailedError) as caught:
        failing("step", error).step([])
    assert f"while running: {text}" in str(caught.value)


def test_ctrl_c_passes_where_python_makes_an_exception_of_it() -> None:
    with pytest.raises(KeyboardInterrupt):
        failing("step", KeyboardInterrupt()).step([])


@pytest.mark.usefixtures("handled")
def test_a_model_that_pretends_to_be_ctrl_c_has_failed() -> None:
    with pytest.raises(ModelFailedError, match=r"while running: KeyboardInterrupt"):
        failing("step", KeyboardInterrupt()).step([])


def test_a_state_that_takes_no_value_keeps_the_old_one() -> None:
    model = GuardedModel(Cart())
    model.initialize([])
    assert not model.refuses("LinearSetpoint", 2.0, 1.0)
    assert model.refuses("LinearSetpoint", float("nan"), 1.0)
    assert model.read("LinearSetpoint") == 1.0
