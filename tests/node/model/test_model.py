# SPDX-License-Identifier: MIT
from collections.abc import Sequence
from typing import ClassVar

import pytest

from segway_ecc.node.errors import UnknownNameError
from segway_ecc.node.model.model import Variable, simulate
from segway_ecc.node.model.sectioned import Method, SectionedModel


class Sum(SectionedModel):
    """Adds up its inputs, step by step."""

    name = "sum"
    step_size = 0.5
    method = Method.DISCRETE
    inputs: ClassVar[Sequence[Variable]] = (Variable("A", "m"), Variable("B", "m", 3.0))
    states: ClassVar[Sequence[Variable]] = (Variable("Total", "m"),)
    outputs: ClassVar[Sequence[Variable]] = (Variable("Out", "m"),)
    ended = False

    def input(self, u: Sequence[float]) -> None:
        self.sum = sum(u)

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:
        del t
        return (s[0] + self.sum,)

    def output(self) -> Sequence[float]:
        return (self.s[0],)

    def final(self) -> None:
        self.ended = True


def test_every_step_is_there_with_its_time_inputs_and_outputs_and_the_model_is_terminated() -> None:
    model = Sum()
    samples = list(simulate(model, {"A": 1.0}, 1.5))
    assert [tuple(sample.y) for sample in samples] == [(0.0,), (4.0,), (8.0,), (12.0,)]
    assert [sample.time for sample in samples] == [0.0, 0.5, 1.0, 1.5]
    assert {tuple(sample.u) for sample in samples} == {(1.0, 3.0)}
    assert model.ended


def test_the_duration_is_rounded_to_whole_steps() -> None:
    assert len(list(simulate(Sum(), {}, 1.7))) == 1 + 3


def test_a_model_that_asks_to_stop_ends_sooner() -> None:
    class Stopping(Sum):
        def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:
            self.stopped = s[0] >= 4.0
            return super().dynamic(t, s)

    model = Stopping()
    assert [tuple(sample.y) for sample in simulate(model, {"A": 1.0}, 5.0)] == [(0.0,), (4.0,), (8.0,)]
    assert model.ended
    model.initialize([0.0, 0.0])
    assert not model.stopped


def test_an_input_that_does_not_exist_is_refused_with_those_that_do() -> None:
    with pytest.raises(UnknownNameError, match=r"^no input of model 'sum' is called 'C'; there is A, B$"):
        next(simulate(Sum(), {"C": 1.0}, 1.0))
