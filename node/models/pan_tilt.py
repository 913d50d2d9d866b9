# SPDX-License-Identifier: MIT
"""A pan-tilt unit: a platform that turns about the vertical, and on it a camera that tilts about its own balance.

With p the pan and t the tilt, zero where the camera looks at the horizon, and the camera's moments of inertia Ja along
and Jb across its line of sight, the platform sees

    J(t) = Jp + Jb cos(t)^2 + Ja sin(t)^2        J'(t) = (Ja - Jb) sin(2 t)

and Lagrange's equations are (any text on mechanics)

    J(t) p'' + J'(t) t' p' = pan torque          Jt t'' - J'(t) p'^2 / 2 = tilt torque.
"""

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

INERTIAS: Final = (
    Variable("PanInertia", "kg m2", 0.02, Write.STATIC, minimum=1e-5, maximum=100.0),
    Variable("TiltInertia", "kg m2", 0.015, Write.STATIC, minimum=1e-5, maximum=100.0),
    Variable("SightInertia", "kg m2", 0.004, Write.STATIC, minimum=0.0, maximum=100.0),
    Variable("CrossInertia", "kg m2", 0.012, Write.STATIC, minimum=0.0, maximum=100.0),
)
_JOINTS: Final = ("Pan", "Tilt")
_STEP_SIZE: Final = 0.01


class PanTiltBody(SectionedModel):
    """What turns. A base for the controller and the plant."""

    parameters: ClassVar[Sequence[Variable]] = INERTIAS

    def static(self) -> None:
        """Gather the inertias."""
        p = self.p
        self.pan_inertia, self.tilt_inertia = p["PanInertia"], p["TiltInertia"]
        self.sight, self.across = p["SightInertia"], p["CrossInertia"]

    def inertia(self, tilt: float) -> float:
        """About the vertical, kg m2, at a tilt, rad."""
        return self.pan_inertia + self.across * math.cos(tilt) ** 2 + self.sight * math.sin(tilt) ** 2

    def coupling(self, tilt: float, pan_rate: float, tilt_rate: float) -> tuple[float, float]:
        """What the motion takes of the torques of pan and tilt, N m, at a tilt, rad, and rates, rad/s."""
        slope = (self.sight - self.across) * math.sin(2.0 * tilt)
        return slope * tilt_rate * pan_rate, -0.5 * slope * pan_rate * pan_rate


class PanTiltController(PanTiltBody):
    """Follows angles: what accelerates the references, what the motion takes, and a spring and damper to them."""

    name = "pan-tilt-controller"
    step_size = _STEP_SIZE
    method = Method.DISCRETE
    parameters = (
        *INERTIAS,
        *PARAMETERS,
        Variable("Bandwidth", "rad/s", 12.0, Write.STATIC, minimum=1.0, maximum=30.0),
    )
    inputs = (
        Variable("PanSetpoint", "rad", minimum=-1e4, maximum=1e4),
        Variable("TiltSetpoint", "rad", minimum=-1.5, maximum=1.5),
        *(
            Variable(f"{name}{what}", unit)
            for name in _JOINTS
            for what, unit in (("Angle", "rad"), ("Velocity", "rad/s"))
        ),
    )
    states = reference_states(_JOINTS)
    outputs = (
        Variable("PanTorque", "N m"),
        Variable("TiltTorque", "N m"),
    )

    def static(self) -> None:
        """Gather the gains too."""
        super().static()
        self.limits = ReferenceLimits.from_model(self.p)
        self.stiffness, self.damping = self.p["Bandwidth"] ** 2, 2.0 * self.p["Bandwidth"]

    def input(self, u: Sequence[float]) -> None:
        """Take the set-points and what is measured."""
        self.setpoints, self.measured = u[:2], ((u[2], u[3]), (u[4], u[5]))
        kept = [near(each, *measured) for each, measured in zip(references_in(self.s), self.measured, strict=True)]
        self.s = [value for reference in kept for value in reference]

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """The next references."""
        pairs = zip(references_in(s), self.setpoints, strict=True)
        return [value for each, wanted in pairs for value in self.limits.advance(each, wanted, self.step_size)]

    def output(self) -> Sequence[float]:
        """The torques."""
        (_, pan_rate), (tilt, tilt_rate) = self.measured
        wanted = [
            reference.acceleration
            + self.stiffness * (reference.angle - angle)
            + self.damping * (reference.velocity - rate)
            for reference, (angle, rate) in zip(references_in(self.s), self.measured, strict=True)
        ]
        pan, tilting = self.coupling(tilt, pan_rate, tilt_rate)
        return self.inertia(tilt) * wanted[0] + pan, self.tilt_inertia * wanted[1] + tilting
