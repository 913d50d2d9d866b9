# SPDX-License-Identifier: MIT
"""The controller of a cart on four driven wheels, which turns by their difference: force and moment from velocities.

The wheels roll ahead and are dragged around a curve; both take forces that grow with the velocity,

    m v' = F - b v        J w' = M - c w

and the controller gives what its set-points take, and more where the velocities differ from them:

    F = b v_set + m k (v_set - v)        M = c w_set + J k (w_set - w).

Which wheel gives what is the mixing's part.
"""

import math
from collections.abc import Sequence
from typing import ClassVar, Final

from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.models.cart import POSE_OUTPUTS, POSE_STATES, SETPOINT_STATES

BODY: Final = (
    Variable("Mass", "kg", 20.0, Write.STATIC, minimum=0.1, maximum=1e4),
    Variable("Inertia", "kg m2", 0.8, Write.STATIC, minimum=1e-3, maximum=1e4),
    Variable("RollingFriction", "N s/m", 8.0, Write.STATIC, minimum=0.0, maximum=1e4),
    Variable("TurningFriction", "N m s", 6.0, Write.STATIC, minimum=0.0, maximum=1e4),
)


class SkidSteerController(SectionedModel):
    """Velocities in, force and moment out, with the pose by dead reckoning."""

    name = "skid-steer-controller"
    step_size = 0.01
    method = Method.RUNGE_KUTTA_4
    parameters: ClassVar[Sequence[Variable]] = (
        *BODY,
        Variable("Rate", "1/s", 5.0, Write.STATIC, minimum=0.0, maximum=20.0, tunable=True),
    )
    states = (*SETPOINT_STATES, *POSE_STATES)
    inputs = (Variable("MeasuredVelocity", "m/s"), Variable("MeasuredYawRate", "rad/s"))
    outputs = (*POSE_OUTPUTS, Variable("Force", "N"), Variable("Moment", "N m"))

    def static(self) -> None:
        """Gather the gains."""
        p = self.p
        self.rolling, self.turning = p["RollingFriction"], p["TurningFriction"]
        self.linear_gain, self.angular_gain = p["Mass"] * p["Rate"], p["Inertia"] * p["Rate"]

    def input(self, u: Sequence[float]) -> None:
        """Take the measured velocities, m/s and rad/s."""
        self.velocity, self.yaw_rate = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rates of set-points (zero) and pose."""
        heading = s[4]
        return (0.0, 0.0, self.velocity * math.cos(heading), self.velocity * math.sin(heading), self.yaw_rate)

    def output(self) -> Sequence[float]:
        """Pose, velocities, force and moment."""
        linear, angular, x, y, heading = self.s
        force = self.rolling * linear + self.linear_gain * (linear - self.velocity)
        moment = self.turning * angular + self.angular_gain * (angular - self.yaw_rate)
        return (x, y, heading, self.velocity, self.yaw_rate, force, moment)
