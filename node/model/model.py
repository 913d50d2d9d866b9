# SPDX-License-Identifier: MIT
"""The interface of every model, whatever it is written in, its named variables, and a model stepped through time."""

import enum
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final, NamedTuple, Protocol

from segway_ecc.node.errors import UnknownNameError

LARGEST: Final = sys.float_info.max
"""The bound of a range that has none: only finite values are taken."""


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
        minimum, maximum: The least and the largest value that it may have, in `unit`; plus or minus `LARGEST` for any.
        tunable: Whether it may be written while the robot is armed.
    """

    name: str
    unit: str = "1"
    value: float = 0.0
    write: Write = Write.NEVER
    why: str = ""
    minimum: float = -LARGEST
    maximum: float = LARGEST
    tunable: bool = False

    @property
    def range_text(self) -> str:
        """The range for people, such as `0.01 to 1 m`; empty where there is none."""
        low = "" if self.minimum == -LARGEST else f"{self.minimum:g}"
        high = "" if self.maximum == LARGEST else f"{self.maximum:g}"
        unit = "" if self.unit == "1" else f" {self.unit}"
        text = f"{low} to {high}" if low and high else f"{low} or more" if low else f"{high} or less"
        return f"{text}{unit}" if low or high else ""


def refusal_of(variable: Variable, value: float) -> str:
    """Why a variable cannot have a value, which its range decides; empty where it can."""
    if variable.minimum <= value <= variable.maximum:
        return ""
    allowed = variable.range_text if isfinite(value) else ""
    text = f"allowed is {allowed}" if allowed else "only finite values are taken"
    return f"'{variable.name}' cannot be {value}: {text}"


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
            ModelError: The variable cannot be written, or the value is not finite or not in its range.
        """


def unwrapped(model: Model) -> Model:
    """The model itself, where `model` records the calls into it (`segway_ecc.node.watchdog`): what holds its state."""
    inner: Model = getattr(model, "watched_model", model)
    return inner


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
