# SPDX-License-Identifier: MIT
"""An arm of three links in a vertical plane: shoulder, elbow and wrist.

With a_i the angle of link i from the horizontal, l_i, m_i its length and mass (uniform rods), and M_i the mass of all
links beyond it, Lagrange's equations in these angles are (any text on robots; Siciliano et al., "Robotics", 7.3, has
those of two links)

    sum_j c_ij (cos(a_i - a_j) a_j'' + sin(a_i - a_j) a_j'^2) + g l_i (m_i / 2 + M_i) cos a_i = tau_i - tau_i+1

    c_ii = l_i^2 (m_i / 3 + M_i)        c_ij = l_i l_j (m_j / 2 + M_j)  for j > i

where tau_i is the torque of joint i, which holds link i against the one before: the angle of joint i is a_i - a_i-1.
"""

import itertools
import math
from collections.abc import Sequence
from typing import ClassVar, Final

from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.models.joint_reference import (
    PARAMETERS,
    ReferenceLimits,
    near,
    reference_states,
    references_in,
)

GRAVITY: Final = 9.80665
JOINTS: Final = ("Shoulder", "Elbow", "Wrist")
HANGING: Final = (-0.5 * math.pi, 0.0, 0.0)
"""The angles at which it rests without torque, rad."""
LINKS: Final = tuple(
    Variable(f"{link}{what}", unit, value, Write.STATIC, minimum=1e-3, maximum=100.0)
    for link, length, mass in (("Upper", 0.3, 1.5), ("Fore", 0.25, 1.0), ("Hand", 0.15, 0.5))
    for what, unit, value in (("Length", "m", length), ("Mass", "kg", mass))
)
_STEP_SIZE: Final = 0.01


class ArmBody(SectionedModel):
    """What moves. A base for the controller and the plant."""

    parameters: ClassVar[Sequence[Variable]] = LINKS

    def static(self) -> None:
        """Gather what the links make of lengths and masses."""
        lengths = [self.p[f"{link}Length"] for link in ("Upper", "Fore", "Hand")]
        masses = [self.p[f"{link}Mass"] for link in ("Upper", "Fore", "Hand")]
        beyond = [sum(masses[place + 1 :]) for place in range(3)]
        self.weights = [GRAVITY * lengths[i] * (0.5 * masses[i] + beyond[i]) for i in range(3)]
        self.inertias = [[0.0] * 3 for _ in range(3)]
        for i in range(3):
            self.inertias[i][i] = lengths[i] ** 2 * (masses[i] / 3.0 + beyond[i])
            for j in range(i + 1, 3):
                self.inertias[i][j] = lengths[i] * lengths[j] * (0.5 * masses[j] + beyond[j])
                self.inertias[j][i] = self.inertias[i][j]

    def inertia(self, angles: Sequence[float]) -> list[list[float]]:
        """The matrix of inertia, kg m2, at the links' angles, rad."""
        return [[self.inertias[i][j] * math.cos(angles[i] - angles[j]) for j in range(3)] for i in range(3)]

    def bias(self, angles: Sequence[float], rates: Sequence[float]) -> list[float]:
        """What motion (rad/s) and gravity take of each link's torque, N m, at the links' angles, rad."""
        return [
            sum(self.inertias[i][j] * math.sin(angles[i] - angles[j]) * rates[j] ** 2 for j in range(3))
            + self.weights[i] * math.cos(angles[i])
            for i in range(3)
        ]


class ArmController(ArmBody):
    """Follows the joints' angles by computed torque: what the references take, and a spring and damper to them."""

    name = "arm-controller"
    step_size = _STEP_SIZE
    method = Method.DISCRETE
    parameters = (
        *LINKS,
        *PARAMETERS,
        Variable("Bandwidth", "rad/s", 10.0, Write.STATIC, minimum=1.0, maximum=30.0),
    )
    inputs = (
        *(Variable(f"{n}Setpoint", "rad", v, minimum=-3.2, maximum=3.2) for n, v in zip(JOINTS, HANGING, strict=True)),
        *(Variable(f"{name}Angle", "rad") for name in JOINTS),
        *(Variable(f"{name}Velocity", "rad/s") for name in JOINTS),
    )
    states = reference_states(JOINTS)
    outputs = tuple(Variable(f"{name}Torque", "N m") for name in JOINTS)

    def static(self) -> None:
        """Gather the gains too."""
        super().static()
        self.limits = ReferenceLimits.from_model(self.p)
        self.stiffness, self.damping = self.p["Bandwidth"] ** 2, 2.0 * self.p["Bandwidth"]

    def input(self, u: Sequence[float]) -> None:
        """Take the set-points and what is measured."""
        self.setpoints, self.angles, self.rates = u[:3], u[3:6], u[6:]
        measured = zip(references_in(self.s), self.angles, self.rates, strict=True)
        self.s = [value for each, angle, rate in measured for value in near(each, angle, rate)]

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """The next references."""
        pairs = zip(references_in(s), self.setpoints, strict=True)
        return [value for each, wanted in pairs for value in self.limits.advance(each, wanted, self.step_size)]

    def output(self) -> Sequence[float]:
        """The torques: those of the links, of which each joint carries all beyond it."""
        wanted = [
            reference.acceleration
            + self.stiffness * (reference.angle - angle)
            + self.damping * (reference.velocity - rate)
            for reference, angle, rate in zip(references_in(self.s), self.angles, self.rates, strict=True)
        ]
        angles, rates, accelerations = (list(itertools.accumulate(each)) for each in (self.angles, self.rates, wanted))
        inertia, bias = self.inertia(angles), self.bias(angles, rates)
        of_links = [bias[i] + sum(inertia[i][j] * accelerations[j] for j in range(3)) for i in range(3)]
        return [sum(of_links[i:]) for i in range(3)]
