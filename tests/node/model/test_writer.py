# SPDX-License-Identifier: MIT
"""Writes from outside: checked, tried, and applied whole or not at all."""

from array import array
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from segway_ecc.node.model.declared import declared_variables
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.model.undo import MOST_VALUES
from segway_ecc.node.model.writer import VariableWriter

NOW: Sequence[float] = [1.0]


class Lever(SectionedModel):
    """Divides by its length in the static equations, and by its stiffness in the dynamic ones."""

    name = "lever"
    step_size = 0.1
    method = Method.EULER
    inputs = (Variable("Force", "N"),)
    outputs = (Variable("Angle", "rad"),)
    parameters = (
        Variable("Length", "m", 2.0, Write.STATIC),
        Variable("Stiffness", "N/m", 4.0, Write.STATIC, tunable=True),
        Variable("Mass", "kg", 1.0, Write.NEVER),
        Variable("Damping", "N s/m", 1.0, Write.STATIC, minimum=0.0, maximum=9.0),
    )
    states = (Variable("Bend", "m", 0.5, Write.NOW),)

    def __init__(self) -> None:
        super().__init__()
        self.journal: list[str] = []
        self.table: dict[str, Any] = {"rows": [[1.0], (2.0,)], "seen": {1}}

    def static(self) -> None:
        self.table["rows"][0][0] = self.p["Length"]
        self.table["seen"].add(self.p["Length"])
        self.arm = 1.0 / self.p["Length"]
        if self.p["Length"] == 3.0:
            self.third = True

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:
        del t
        self.journal.append("step")
        return [self._u[0] / self.p["Stiffness"] - s[0]]

    def output(self) -> Sequence[float]:
        return [1e308 * self.p["Damping"] if self.p["Damping"] > 5.0 else self.s[0] * self.arm]


@pytest.fixture
def lever() -> Lever:
    lever = Lever()
    lever.initialize(NOW)
    lever.step(NOW)
    return lever


@pytest.fixture
def writer(lever: Lever) -> VariableWriter:
    return VariableWriter(lever, declared_variables(lever))


def everything(lever: Lever) -> object:
    return repr(sorted(vars(lever).items()))


def test_a_write_is_applied_whole_and_its_trial_leaves_nothing_behind(lever: Lever, writer: VariableWriter) -> None:
    other = Lever()
    other.initialize(NOW)
    other.step(NOW)
    for name, value in (("Length", 4.0), ("Bend", 0.7)):
        other.write(name, value)

    assert writer.write([("Length", 4.0), ("Bend", 0.7)], NOW) == ""
    assert everything(lever) == everything(other)
    assert lever.step(NOW) == other.step(NOW)
    assert (writer.written, writer.refused) == (1, 0)


@pytest.mark.parametrize(
    ("values", "refusal"),
    [
        ({"Length": 0.0}, "'Length' cannot be 0.0: ZeroDivisionError: float division by zero"),
        ({"Stiffness": 0.0}, "the model cannot take a step with Stiffness = 0.0: ZeroDivisionError: float division"),
        (
            {"Damping": 6.0},
            "the model cannot take a step with Damping = 6.0: ArithmeticError: its output 'Angle' would",
        ),
        ({"Length": 3.0, "Stiffness": 0.0}, "the model cannot take a step with Length = 3.0, Stiffness = 0.0: "),
        ({"Length": 3.0, "Damping": 10.0}, "'Damping' cannot be 10.0: allowed is 0 to 9 N s/m"),
        ({"Damping": -0.1}, "'Damping' cannot be -0.1: allowed is 0 to 9 N s/m"),
        ({"Length": float("nan")}, "'Length' cannot be nan: only finite values are taken"),
        ({"Damping": float("inf")}, "'Damping' cannot be inf: only finite values are taken"),
        ({"Mass": 2.0}, "'Mass' of model 'lever' cannot be written: not while it runs"),
        ({"Force": 2.0}, "no writable variable of model 'lever' is called 'Force'"),
        ({"Lenght": 2.0}, "no writable variable of model 'lever' is called 'Lenght'"),
    ],
)
def test_a_write_that_is_refused_changes_nothing_and_blocks_no_later_one(
    lever: Lever, writer: VariableWriter, values: dict[str, float], refusal: str
) -> None:
    before = everything(lever)
    assert writer.write(list(values.items()), NOW).startswith(refusal)
    assert everything(lever) == before
    assert (writer.written, writer.refused) == (0, 1)
    assert writer.write([("Length", 4.0)], NOW) == ""
    assert lever.read("Length") == 4.0


def test_while_armed_only_what_is_declared_tunable_is_written(lever: Lever, writer: VariableWriter) -> None:
    refusal = writer.write([("Stiffness", 5.0), ("Length", 4.0)], NOW, is_armed=True)
    assert refusal == "'Length' is not tunable while the robot is armed: disarm it first"
    assert (lever.read("Stiffness"), lever.read("Length")) == (4.0, 2.0)
    assert writer.write([("Stiffness", 5.0)], NOW, is_armed=True) == ""
    assert lever.read("Stiffness") == 5.0


def test_a_model_whose_outputs_are_not_finite_can_be_mended(lever: Lever, writer: VariableWriter) -> None:
    lever.p["Damping"] = 6.0
    assert writer.write([("Length", 4.0)], NOW, is_sound=False) == ""
    assert writer.write([("Damping", 1.0)], NOW, is_sound=False) == ""


def test_before_it_is_initialized_no_step_is_tried(lever: Lever) -> None:
    lever = Lever()
    assert VariableWriter(lever, declared_variables(lever)).write([("Length", 4.0)]) == ""
    assert lever.journal == []


class Opaque(Lever):
    """Holds what cannot be seen into."""

    def __init__(self, kept: object) -> None:
        super().__init__()
        self.kept = kept


def counter() -> Callable[[], int]:
    count = 0

    def add() -> int:
        nonlocal count
        count += 1
        return count

    return add


@pytest.mark.parametrize(
    "kept", [counter(), iter([1]), [0.0] * (MOST_VALUES + 1)], ids=["closure", "iterator", "large"]
)
def test_a_model_whose_state_cannot_be_kept_takes_no_write_while_armed(kept: object) -> None:
    model = Opaque(kept)
    model.initialize(NOW)
    writer = VariableWriter(model, declared_variables(model))
    assert writer.write([("Stiffness", 5.0)], NOW, is_armed=True).startswith(
        "a write that failed could not be taken back, so disarm the robot first: "
    )
    assert model.read("Stiffness") == 4.0
    assert writer.write([("Stiffness", 5.0)], NOW) == ""
    assert (model.read("Stiffness"), model.journal) == (5.0, []), "written, and no step tried"


def test_a_model_whose_state_cannot_be_kept_is_written_back_and_initialized_where_a_write_fails() -> None:
    model = Opaque(iter([1]))
    model.initialize(NOW)
    model.step(NOW)
    writer = VariableWriter(model, declared_variables(model))
    assert writer.write([("Stiffness", 5.0), ("Length", 0.0)], NOW).startswith("'Length' cannot be 0.0: ZeroDivision")
    assert (model.read("Stiffness"), model.read("Length"), model.arm) == (4.0, 2.0, 0.5)
    assert model.time == 0.0


class Weighted(Lever):
    """Has arrays of numbers, which its static equations change."""

    def __init__(self, weights: Any) -> None:
        super().__init__()
        self.weights = weights

    def static(self) -> None:
        super().static()
        self.weights[0] = int(self.p["Length"])


@pytest.mark.parametrize(
    "weights",
    [np.arange(6.0), np.arange(6, dtype=np.float32), array("d", [5.0, 6.0]), bytearray(b"ab")],
    ids=["float64", "float32", "array", "bytearray"],
)
def test_arrays_of_numbers_are_kept_too(weights: Any) -> None:
    model = Weighted(weights)
    model.initialize(NOW)
    before = bytes(weights)
    writer = VariableWriter(model, declared_variables(model, {}, ["Length"]))
    assert writer.write([("Length", 4.0), ("Stiffness", 0.0)], NOW, is_armed=True) != ""
    assert bytes(weights) == before
    assert writer.write([("Length", 4.0)], NOW, is_armed=True) == ""
    assert weights[0] == 4


@pytest.mark.parametrize(
    "weights", [np.zeros(1 << 20), np.array([1.0, None]), np.zeros((4, 4))[:, 0]], ids=["large", "objects", "strided"]
)
def test_arrays_that_are_too_large_or_no_plain_memory_are_not_kept(weights: Any) -> None:
    model = Weighted(weights)
    model.initialize(NOW)
    writer = VariableWriter(model, declared_variables(model))
    assert "could not be taken back" in writer.write([("Stiffness", 5.0)], NOW, is_armed=True)
    assert writer.write([("Stiffness", 5.0)], NOW) == ""


class Saving(Lever):
    """Keeps its own state."""

    def save_state(self) -> bytes:
        if self.p["Mass"] == 9.0:
            raise LookupError("no room")
        return repr((self.p, self.s, self._steps)).encode()

    def restore_state(self, data: bytes) -> None:
        self.p, self.s, self._steps = eval(data)  # noqa: S307 - what we wrote
        self.static()


def test_a_models_own_state_is_what_is_put_back() -> None:
    model = Saving()
    model.initialize(NOW)
    model.step(NOW)
    writer = VariableWriter(model, declared_variables(model))
    assert writer.write([("Length", 4.0), ("Stiffness", 0.0)], NOW) != ""
    assert (model.read("Length"), model.read("Stiffness"), model.arm, model._steps) == (2.0, 4.0, 0.5, 1)
    model.p["Mass"] = 9.0
    assert "LookupError: no room" in writer.write([("Stiffness", 5.0)], NOW, is_armed=True)


def test_a_refusal_is_short(lever: Lever, writer: VariableWriter) -> None:
    def static() -> None:
        raise ValueError("x" * 10_000)

    lever.static = static  # type: ignore[method-assign]
    assert len(writer.write([("Length", 3.0)])) < 400
