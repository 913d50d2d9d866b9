# SPDX-License-Identifier: MIT
"""The cart of the case study as a plant: motors, wheels and the way they roll, without its controller.

The equations are those of `segway_ecc.node.models.cart`, where they are derived; the frames are its frames.
The IMU sits in the middle of the axle: it measures the yaw rate, and as specific force (REP-145) what speeds the cart
up, what keeps it on its curve, and the floor that carries it. The outputs are those of every two-wheeled plant.
"""

from collections.abc import Sequence
from typing import Final

from segway_ecc.hil.plants.placing import WheelMotion
from segway_ecc.node.model.model import Variable
from segway_ecc.node.models.cart import POSE_STATES, WHEEL_PARAMETERS, WHEEL_STATES, CartBody

WHEEL_OUTPUTS: Final = tuple(
    Variable(f"{side}.{name}", unit)
    for side in ("left", "right")
    for name, unit in (("angle", "rad"), ("velocity", "rad/s"))
)
IMU_OUTPUTS: Final = tuple(
    Variable(f"imu.{name}_{axis}", unit)
    for name, unit in (("angular_velocity", "rad/s"), ("linear_acceleration", "m/s2"))
    for axis in "xyz"
)
POSE_OUTPUTS: Final = (
    Variable("truth.x", "m"),
    Variable("truth.y", "m"),
    Variable("truth.heading", "rad"),
    Variable("truth.linear_velocity", "m/s"),
    Variable("truth.angular_velocity", "rad/s"),
)


STEP_SIZE: Final = 0.005
STANDARD_GRAVITY: Final = 9.80665


class _RollingCart(CartBody):
    """What both plants have: where the cart is, and what is measured of it."""

    step_size = STEP_SIZE
    parameters = WHEEL_PARAMETERS
    outputs = (*WHEEL_OUTPUTS, *POSE_OUTPUTS, *IMU_OUTPUTS)

    def measured(
        self, wheels: Sequence[float], accelerations: Sequence[float], pose: Sequence[float]
    ) -> Sequence[float]:
        """The outputs.

        Args:
            wheels: Left angle and velocity, right angle and velocity; rad, rad/s.
            accelerations: Left and right angular acceleration, rad/s2.
            pose: x, y, heading; m, m, rad.
        """
        speed, yaw_rate = self.velocities(wheels[1], wheels[3])
        ahead, _ = self.velocities(*accelerations)
        return (*wheels, *pose, speed, yaw_rate, 0.0, 0.0, yaw_rate, ahead, speed * yaw_rate, STANDARD_GRAVITY)

    def begin_at(self, motion: WheelMotion, u: Sequence[float]) -> Sequence[float]:
        """See `Placeable.begin_at`; where a voltage drives it, the current is that of this moment's speed."""
        values = {
            "LeftRotation": motion.left_angle,
            "LeftSpeed": motion.left_velocity,
            "RightRotation": motion.right_angle,
            "RightSpeed": motion.right_velocity,
        }
        for place, side in enumerate(("Left", "Right")):
            if f"{side}Current" in self._state_at:
                voltage = u[place] - self.motor_constant * values[f"{side}Speed"]
                values[f"{side}Current"] = voltage / self.resistance
        for name, value in values.items():
            self.s[self._state_at[name]] = value
        self.input(u)
        return self.output()


class CartPlant(_RollingCart):
    """Two motor voltages in; wheel angles and speeds, the IMU, and where the cart really is, out."""

    name = "cart-plant"
    inputs = (Variable("left.voltage", "V"), Variable("right.voltage", "V"))
    states = (*WHEEL_STATES, *POSE_STATES)

    def input(self, u: Sequence[float]) -> None:
        """Take the motor voltages, V."""
        self.left_voltage, self.right_voltage = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rates of motors, wheel angles and pose."""
        il, wl, ir, wr, _, _, _, _, heading = s
        left = self.motor_rates(self.left_voltage, il, wl)
        right = self.motor_rates(self.right_voltage, ir, wr)
        return (*left, *right, wl, wr, *self.pose_rates(wl, wr, heading))

    def output(self) -> Sequence[float]:
        """Wheels, pose and IMU."""
        il, wl, ir, wr, left, right, *pose = self.s
        _, left_rate = self.motor_rates(self.left_voltage, il, wl)
        _, right_rate = self.motor_rates(self.right_voltage, ir, wr)
        return self.measured((left, wl, right, wr), (left_rate, right_rate), pose)


class CartTorquePlant(_RollingCart):
    """The same cart behind drives that control torque: two wheel torques in, the same out."""

    name = "cart-torque-plant"
    inputs = (Variable("left.torque", "N m"), Variable("right.torque", "N m"))
    states = (
        Variable("LeftSpeed", "rad/s"),
        Variable("RightSpeed", "rad/s"),
        Variable("LeftRotation", "rad"),
        Variable("RightRotation", "rad"),
        *POSE_STATES,
    )

    def input(self, u: Sequence[float]) -> None:
        """Take the wheel torques, N m."""
        self.left_torque, self.right_torque = u

    def accelerations(self, left: float, right: float) -> tuple[float, float]:
        """Angular accelerations of the wheels, rad/s2, at their speeds, rad/s."""
        return (
            (self.left_torque - self.friction * left) * self.per_inertia,
            (self.right_torque - self.friction * right) * self.per_inertia,
        )

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rates of wheel speeds, wheel angles and pose."""
        left, right, _, _, _, _, heading = s
        return (*self.accelerations(left, right), left, right, *self.pose_rates(left, right, heading))

    def output(self) -> Sequence[float]:
        """Wheels, pose and IMU."""
        wl, wr, left, right, *pose = self.s
        return self.measured((left, wl, right, wr), self.accelerations(wl, wr), pose)
