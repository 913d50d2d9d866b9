# SPDX-License-Identifier: MIT
"""What a rig asks of a plant beside one step: several at once, where nobody looks between them."""

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

from segway_ecc.node.model.model import Model

Advance = Callable[[Sequence[float], int], Sequence[float]]
"""(inputs, number of steps) -> the outputs after the last of them."""


@runtime_checkable
class Advancing(Protocol):
    """A plant that can make several steps at once, at less cost."""

    def advance(self, u: Sequence[float], steps: int) -> list[float]:
        """Make one or more steps with the same inputs; returns the outputs after the last one."""


def advance_of(plant: Model) -> Advance:
    """The plant's own way of making several steps, or one after the other."""
    if isinstance(plant, Advancing):
        return plant.advance

    def advance(u: Sequence[float], steps: int) -> Sequence[float]:
        for _ in range(steps - 1):
            plant.step(u)
        return plant.step(u)

    return advance
