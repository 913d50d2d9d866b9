# SPDX-License-Identifier: MIT
"""A pan-tilt unit as a plant: the equations of `segway_ecc.node.models.pan_tilt`, and friction in its bearings."""

from collections.abc import Sequence
from typing import Final

from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method
from segway_ecc.node.models.pan_tilt import INERTIAS, PanTiltBody

_AXES: Final = ("pan", "tilt")


class PanTiltPlant(PanTiltBody):
    """Two torques in; the angles and velocities of both axes, and the energy of their motion, out."""

    name = "pan-tilt-plant"
    step_size = 0.001
    method = Method.RUNGE_KUTTA_4
    parameters = (
        *INERTIAS,
        Variable("PanFriction", "N m s", 0.05, Write.STATIC, minimum=0.0, maximum=100.0),
        Variable("TiltFriction", "N m s", 0.03, Write.STATIC, minimum=0.0, maximum=100.0),
    )
    inputs = tuple(Variable(f"{axis}.torque", "N m") for axis in _AXES)
    states = (
        Variable("Pan", "rad", 0.0, Write.NOW),
        Variable("PanRate", "rad/s", 0.0, Write.NOW),
        Variable("Tilt", "rad", 0.0, Write.NOW),
        Variable("TiltRate", "rad/s", 0.0, Write.NOW),
    )
    outputs = (
        *(
            Variable(f"{axis}.{what}", unit)
            for axis in _AXES
            for what, unit in (("angle", "rad"), ("velocity", "rad/s"))
        ),
        Variable("truth.energy", "J"),
    )

    def static(self) -> None:
        """Gather the friction too."""
        super().static()
        self.pan_friction, self.tilt_friction = self.p["PanFriction"], self.p["TiltFriction"]

    def input(self, u: Sequence[float]) -> None:
        """Take the torques, N m."""
        self.pan_torque, self.tilt_torque = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rates of the angles and velocities."""
        _, pan_rate, tilt, tilt_rate = s
        pan, tilting = self.coupling(tilt, pan_rate, tilt_rate)
        return (
            pan_rate,
            (self.pan_torque - self.pan_friction * pan_rate - pan) / self.inertia(tilt),
            tilt_rate,
            (self.tilt_torque - self.tilt_friction * tilt_rate - tilting) / self.tilt_inertia,
        )

    def output(self) -> Sequence[float]:
        """Angles, velocities, energy."""
        _, pan_rate, tilt, tilt_rate = self.s
        energy = 0.5 * (self.inertia(tilt) * pan_rate**2 + self.tilt_inertia * tilt_rate**2)
        return (*self.s, energy)
