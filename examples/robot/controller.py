# SPDX-License-Identifier: MIT
"""Each wheel's velocity held by a proportional controller, for a robot with two wheels 0.3 m apart."""

from collections.abc import Sequence

from segway_ecc import Method, SectionedModel, Variable, Write

RADIUS = 0.05
TRACK = 0.3


class Controller(SectionedModel):
    """Wheel velocities in, motor voltages out; a state without a rate keeps the set-point that is written to it."""

    name = "controller"
    step_size = 0.01
    method = Method.DISCRETE
    parameters = (Variable("Gain", "V s/rad", 0.3),)
    inputs = (Variable("LeftVelocity", "rad/s"), Variable("RightVelocity", "rad/s"))
    states = (Variable("Linear", "m/s", 0.0, Write.NOW), Variable("Angular", "rad/s", 0.0, Write.NOW))
    outputs = (Variable("LeftVoltage", "V"), Variable("RightVoltage", "V"))

    def input(self, u: Sequence[float]) -> None:
        """Take the wheels' angular velocities, rad/s."""
        self.left, self.right = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - as it was
        """The next states: the set-points stay."""
        return tuple(s)

    def output(self) -> Sequence[float]:
        """The motor voltages, V."""
        linear, angular = self.s
        turn = angular * TRACK / 2.0
        left, right = (linear - turn) / RADIUS, (linear + turn) / RADIUS
        return (self.p["Gain"] * (left - self.left), self.p["Gain"] * (right - self.right))
