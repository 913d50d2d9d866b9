# SPDX-License-Identifier: MIT
"""Two wheels on a stand, each with a motor: a plant of one's own, for robots on a wheel board.

A plant is a model like any other. Its inputs have the names of the drive's commands, its outputs those of its signals.
"""

from collections.abc import Sequence

from segway_ecc import Method, SectionedModel, Variable


class TwoWheels(SectionedModel):
    """Two motor voltages in; the wheels' angles and velocities out."""

    name = "two-wheels"
    step_size = 0.005
    method = Method.RUNGE_KUTTA_4
    parameters = (Variable("Gain", "rad/(V s)", 10.0), Variable("TimeConstant", "s", 0.1))
    inputs = (Variable("left.voltage", "V"), Variable("right.voltage", "V"))
    states = (
        Variable("LeftAngle", "rad"),
        Variable("LeftVelocity", "rad/s"),
        Variable("RightAngle", "rad"),
        Variable("RightVelocity", "rad/s"),
    )
    outputs = (
        Variable("left.angle", "rad"),
        Variable("left.velocity", "rad/s"),
        Variable("right.angle", "rad"),
        Variable("right.velocity", "rad/s"),
    )

    def input(self, u: Sequence[float]) -> None:
        """Take the motor voltages, V."""
        self.left_voltage, self.right_voltage = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rates of angles and velocities."""
        _, left, _, right = s
        return (left, self.rate(self.left_voltage, left), right, self.rate(self.right_voltage, right))

    def rate(self, voltage: float, velocity: float) -> float:
        """Angular acceleration of a wheel, rad/s2, at a motor voltage, V, and an angular velocity, rad/s."""
        return (self.p["Gain"] * voltage - velocity) / self.p["TimeConstant"]

    def output(self) -> Sequence[float]:
        """Angles, rad, and velocities, rad/s."""
        return tuple(self.s)
