# SPDX-License-Identifier: MIT
"""A cart on four driven wheels as a plant: its body, for which its wheels are a force and a moment.

The equations are those of `segway_ecc.node.models.skid_steer`. It knows of no wheels: what their drives give is mixed
to force and moment, and how it moves to their angles, by the wiring of the robot file. Wheels that are dragged around a
curve turn as if the track were wider; the geometry has that track.
"""

import math
from collections.abc import Sequence

from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.models.cart import POSE_STATES
from segway_ecc.node.models.skid_steer import BODY


class SkidSteerPlant(SectionedModel):
    """Force and moment in; velocities, way and turn, and where the cart really is, out."""

    name = "skid-steer-plant"
    step_size = 0.001
    method = Method.RUNGE_KUTTA_4
    parameters = BODY
    inputs = (Variable("Force", "N"), Variable("Moment", "N m"))
    states = (
        Variable("Speed", "m/s"),
        Variable("YawRate", "rad/s"),
        Variable("Way", "m"),
        *POSE_STATES,
    )
    outputs = (
        Variable("Speed", "m/s"),
        Variable("YawRate", "rad/s"),
        Variable("Way", "m"),
        Variable("Turn", "rad"),
        Variable("truth.x", "m"),
        Variable("truth.y", "m"),
        Variable("truth.heading", "rad"),
        Variable("truth.linear_velocity", "m/s"),
        Variable("truth.angular_velocity", "rad/s"),
    )

    def static(self) -> None:
        """Gather the parameters as the equations use them."""
        p = self.p
        self.rolling, self.turning = p["RollingFriction"], p["TurningFriction"]
        self.per_mass, self.per_inertia = 1.0 / p["Mass"], 1.0 / p["Inertia"]

    def input(self, u: Sequence[float]) -> None:
        """Take force, N, and moment, N m."""
        self.force, self.moment = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rates of velocities, way and pose."""
        speed, yaw_rate, _, _, _, heading = s
        return (
            (self.force - self.rolling * speed) * self.per_mass,
            (self.moment - self.turning * yaw_rate) * self.per_inertia,
            speed,
            speed * math.cos(heading),
            speed * math.sin(heading),
            yaw_rate,
        )

    def output(self) -> Sequence[float]:
        """Velocities, way, turn and pose."""
        speed, yaw_rate, way, x, y, heading = self.s
        return (speed, yaw_rate, way, heading, x, y, heading, speed, yaw_rate)
