# SPDX-License-Identifier: MIT
"""The interface of every model, whatever it is written in."""

from collections.abc import Sequence
from typing import Protocol

from segway_ecc.node.model.variables import Variable


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
