"""The cart of the case study as a plant: motors, wheels and the way they roll, without its controller."""

from collections.abc import Sequence
from typing import Final

from node.model.variables import Variable
from node.models.cart import POSE_STATES, WHEEL_PARAMETERS, WHEEL_STATES, CartBody

STEP_SIZE: Final = 0.005


class CartPlant(CartBody):
    """Two motor voltages in; wheel angles and speeds, and where the cart really is, out.

    The equations are those of `node.models.cart`, where they are derived; the frames are its frames.
    """

    name = "cart-plant"
    step_size = STEP_SIZE
    parameters = WHEEL_PARAMETERS
    inputs = (Variable("left.voltage", "V"), Variable("right.voltage", "V"))
    states = (*WHEEL_STATES, *POSE_STATES)
    outputs = (
        Variable("left.angle", "rad"),
        Variable("left.velocity", "rad/s"),
        Variable("right.angle", "rad"),
        Variable("right.velocity", "rad/s"),
        Variable("truth.x", "m"),
        Variable("truth.y", "m"),
        Variable("truth.heading", "rad"),
        Variable("truth.linear_velocity", "m/s"),
        Variable("truth.angular_velocity", "rad/s"),
    )

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
        """Wheel angles and speeds, and the true pose."""
        _, wl, _, wr, left, right, x, y, heading = self.s
        return (left, wl, right, wr, x, y, heading, *self.velocities(wl, wr))
