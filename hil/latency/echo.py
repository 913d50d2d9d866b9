# SPDX-License-Identifier: MIT
"""A model that gives its set-point to a motor, so that a motor frame shows which set-point it was made from."""

from collections.abc import Sequence

from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import Method, SectionedModel


class Echo(SectionedModel):
    """The voltage of the left motor, V, is the forward velocity that was asked for, m/s."""

    name = "echo"
    step_size = 0.01
    method = Method.DISCRETE
    inputs = (Variable("Setpoint", "m/s"),)
    outputs = (Variable("Left", "V"), Variable("Right", "V"))

    def input(self, u: Sequence[float]) -> None:
        """Take the set-point."""
        (self.setpoint,) = u

    def output(self) -> Sequence[float]:
        """Hand it on."""
        return self.setpoint, 0.0
