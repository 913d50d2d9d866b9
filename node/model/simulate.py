# SPDX-License-Identifier: MIT
"""A model alone, stepped through time."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from segway_ecc.node.errors import UnknownNameError
from segway_ecc.node.model.model import Model


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
    u = held_inputs(model, inputs)
    yield Sample(0.0, u, model.initialize(u))
    for step in range(1, round(duration / model.step_size) + 1):
        yield Sample(step * model.step_size, u, model.step(u))
        if model.stopped:
            break
    model.terminate()


def held_inputs(model: Model, inputs: Mapping[str, float]) -> list[float]:
    """The inputs in port order: those given, else their start values.

    Raises:
        UnknownNameError: The model has no such input.
    """
    names = [v.name for v in model.inputs]
    for name in inputs:
        if name not in names:
            raise UnknownNameError(f"input of model '{model.name}'", name, names)
    return [inputs.get(v.name, v.value) for v in model.inputs]
