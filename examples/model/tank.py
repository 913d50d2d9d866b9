# SPDX-License-Identifier: MIT
"""A water tank with an outlet: a model of one's own, in its sections."""

from collections.abc import Sequence

from segway_ecc import Method, SectionedModel, Variable, Write


class Tank(SectionedModel):
    """The inflow is an input; the outlet's resistance may be changed while the model runs."""

    name = "tank"
    step_size = 0.01
    method = Method.RUNGE_KUTTA_4
    parameters = (Variable("Resistance", "s/m2", 2.0, Write.STATIC),)
    inputs = (Variable("Inflow", "m3/s"),)
    states = (Variable("Volume", "m3"),)
    outputs = (Variable("Outflow", "m3/s"),)

    def static(self) -> None:
        """What depends on parameters only."""
        self.conductance = 1.0 / self.p["Resistance"]

    def input(self, u: Sequence[float]) -> None:
        """Take the inflow, m3/s."""
        (self.inflow,) = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rate of the volume, m3/s."""
        return (self.inflow - self.conductance * s[0],)

    def output(self) -> Sequence[float]:
        """The outflow, m3/s."""
        return (self.conductance * self.s[0],)
