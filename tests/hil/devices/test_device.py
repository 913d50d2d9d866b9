# SPDX-License-Identifier: MIT
"""Several steps of a plant, whether it knows how to make them at once or not."""

from collections.abc import Sequence

from segway_ecc.hil.devices.device import advance_of
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import SectionedModel


class Counter(SectionedModel):
    """Adds its input at each step."""

    name = "counter"
    step_size = 0.001
    inputs = (Variable("More"),)
    outputs = (Variable("Sum"),)

    def initial(self) -> None:
        self.sum = 0.0

    def input(self, u: Sequence[float]) -> None:
        self.sum += u[0]

    def output(self) -> Sequence[float]:
        return (self.sum,)


class Leaper(Counter):
    """Makes any number of steps at once."""

    def advance(self, u: Sequence[float], steps: int) -> list[float]:
        self.sum += 100.0 * steps * u[0]
        return [self.sum]


def test_one_step_after_the_other() -> None:
    plant = Counter()
    plant.initialize((0.0,))
    assert advance_of(plant)((2.0,), 3) == [6.0]
    assert advance_of(plant)((1.0,), 1) == [7.0]
    assert plant.time == 0.004


def test_at_once_where_the_plant_knows_how() -> None:
    plant = Leaper()
    plant.initialize((0.0,))
    assert advance_of(plant)((2.0,), 3) == [600.0]
