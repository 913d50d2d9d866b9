# SPDX-License-Identifier: MIT
"""The interface of every model, whatever it is written in, its named variables, and a model stepped through time."""

import enum
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from segway_ecc.node.errors import ModelError, UnknownNameError


@enum.unique
class Write(enum.StrEnum):
    """When a write to a variable takes effect."""

    NOW = "now"
    """At the next step."""
    STATIC = "static"
    """At the next step, through the static equations, which the write runs again."""
    RESET = "reset"
    """When the model is initialized again."""
    NEVER = "never"
    """The variable cannot be written."""


@dataclass(frozen=True, slots=True)
class Variable:
    """One input, output, parameter or state of a model.

    Attributes:
        name: As the model gives it; unique within the model.
        unit: SI unit symbol, "1" for none.
        value: Start value, in `unit`.
        write: When a write takes effect.
        why: What decides that, in a few words; empty where the model's author declares it.
    """

    name: str
    unit: str = "1"
    value: float = 0.0
    write: Write = Write.NEVER
    why: str = ""


class Model(Protocol):
    """A model that advances one fixed step at a time.

    Inputs and outputs are sequences of floats in the order of `inputs` and `outputs`.

    Five methods are to be written. The rest is data, and mostly plain attributes where it is implemented; properties
    here, since only so may one model have a class attribute (`SectionedModel`) where another has one of the instance.
    """

    @property
    def name(self) -> str:
        """The model's name."""

    @property
    def step_size(self) -> float:
        """The length of one step, s."""

    @property
    def inputs(self) -> Sequence[Variable]:
        """The input ports."""

    @property
    def outputs(self) -> Sequence[Variable]:
        """The output ports."""

    @property
    def parameters(self) -> Sequence[Variable]:
        """The parameters."""

    @property
    def states(self) -> Sequence[Variable]:
        """The states."""

    @property
    def stopped(self) -> bool:
        """Whether the model itself has asked to stop, as 20-sim's `stopsimulation` does; it can still be stepped."""

    def initialize(self, u: Sequence[float]) -> list[float]:
        """Run the initial and static sections under inputs `u`; return the outputs at time zero."""

    def step(self, u: Sequence[float]) -> list[float]:
        """Hold inputs `u` over one step; return the outputs at its end."""

    def terminate(self) -> None:
        """Run the final section."""

    def read(self, name: str) -> float:
        """Return the present value of a parameter, state, input or output.

        Raises:
            UnknownNameError: The model has no such name.
        """

    def write(self, name: str, value: float) -> None:
        """Write a parameter or a state; `Variable.write` is when it takes effect.

        Raises:
            UnknownNameError: The model has no such name.
            ModelError: The variable cannot be written, or the value is not finite.
        """


def write_variable(model: Model, name: str, value: float) -> str:
    """Write a parameter or a state; returns why the model refuses it, empty where it does not."""
    try:
        try:
            model.write(name, value)
        except ModelError:
            raise
        except Exception as error:  # the model is the user's and may raise anything
            raise ModelError(f"'{name}' cannot be {value}: {type(error).__name__}: {error}") from error
    except ModelError as error:
        return str(error)
    return ""


class Sample(NamedTuple):
    """A model at one moment: time (s), the inputs held from then on, and the outputs."""

    time: float
    u: Sequence[float]
    y: Sequence[float]


def simulate(model: Model, inputs: Mapping[str, float], duration: float) -> Iterator[Sample]:
    """Hold inputs for some time, from initialize to terminate.

    Args:
        model: The model.
        inputs: Values of inputs by name; the others keep their start values.
        duration: How long, s; rounded to whole steps. A model that asks to stop ends sooner.

    Yields:
        The start, and the end of each step.

    Raises:
        UnknownNameError: The model has no such input.
    """
    names = [v.name for v in model.inputs]
    for name in inputs:
        if name not in names:
            raise UnknownNameError(f"input of model '{model.name}'", name, names)
    u = [inputs.get(v.name, v.value) for v in model.inputs]
    yield Sample(0.0, u, model.initialize(u))
    for step in range(1, round(duration / model.step_size) + 1):
        yield Sample(step * model.step_size, u, model.step(u))
        if model.stopped:
            break
    model.terminate()
