# SPDX-License-Identifier: MIT
"""An arm of three links as a plant: the equations of `segway_ecc.node.models.planar_arm`, and friction in joints."""

import itertools
import math
from collections.abc import Sequence
from typing import Final

from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method
from segway_ecc.node.models.planar_arm import HANGING, JOINTS, LINKS, ArmBody

_AXES: Final = tuple(name.lower() for name in JOINTS)


class PlanarArmPlant(ArmBody):
    """Three torques in; the joints' angles and velocities, and the energy of the links, out. At first it hangs."""

    name = "planar-arm-plant"
    step_size = 0.001
    method = Method.RUNGE_KUTTA_4
    parameters = (
        *LINKS,
        *(
            Variable(f"{name}Friction", "N m s", value, Write.STATIC, minimum=0.0, maximum=100.0)
            for name, value in zip(JOINTS, (0.3, 0.1, 0.02), strict=True)
        ),
    )
    inputs = tuple(Variable(f"{axis}.torque", "N m") for axis in _AXES)
    states = (
        *(Variable(name, "rad", angle, Write.NOW) for name, angle in zip(JOINTS, HANGING, strict=True)),
        *(Variable(f"{name}Rate", "rad/s", 0.0, Write.NOW) for name in JOINTS),
    )
    outputs = (
        *(Variable(f"{axis}.angle", "rad") for axis in _AXES),
        *(Variable(f"{axis}.velocity", "rad/s") for axis in _AXES),
        Variable("truth.energy", "J"),
    )

    def static(self) -> None:
        """Gather the friction too."""
        super().static()
        self.frictions = [self.p[f"{name}Friction"] for name in JOINTS]

    def input(self, u: Sequence[float]) -> None:
        """Take the torques, N m."""
        self.torques = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rates of the joints' angles and velocities."""
        angles, rates = (list(itertools.accumulate(each)) for each in (s[:3], s[3:]))
        joints = [
            torque - friction * rate for torque, friction, rate in zip(self.torques, self.frictions, s[3:], strict=True)
        ]
        of_links = [joint - beyond for joint, beyond in zip(joints, (*joints[1:], 0.0), strict=True)]
        bias = self.bias(angles, rates)
        found = _solved(self.inertia(angles), [of - taken for of, taken in zip(of_links, bias, strict=True)])
        return (*s[3:], found[0], found[1] - found[0], found[2] - found[1])

    def output(self) -> Sequence[float]:
        """Angles, velocities, energy: zero where all links are level and at rest."""
        angles, rates = (list(itertools.accumulate(each)) for each in (self.s[:3], self.s[3:]))
        inertia = self.inertia(angles)
        moving = 0.5 * sum(inertia[i][j] * rates[i] * rates[j] for i in range(3) for j in range(3))
        raised = sum(weight * math.sin(angle) for weight, angle in zip(self.weights, angles, strict=True))
        return (*self.s, moving + raised)


def _solved(matrix: list[list[float]], right: list[float]) -> list[float]:
    """The solution of a system with a symmetric, positive definite matrix, by elimination; both are overwritten."""
    size = len(right)
    for place in range(size):
        for row in range(place + 1, size):
            factor = matrix[row][place] / matrix[place][place]
            for column in range(place, size):
                matrix[row][column] -= factor * matrix[place][column]
            right[row] -= factor * right[place]
    for place in reversed(range(size)):
        known = sum(matrix[place][column] * right[column] for column in range(place + 1, size))
        right[place] = (right[place] - known) / matrix[place][place]
    return right
