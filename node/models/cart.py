# SPDX-License-Identifier: MIT
"""The cart of the case study: two wheels in the plane, each speed-controlled by feedforward plus feedback.

Equations of a wheel (a brushed motor with its load; any text on electric drives):

    L di/dt = V - R i - K w          J dw/dt = K i - b w

and of its controller, with the gain of the feedforward chosen for unit steady-state gain:

    V = kf w_set + kp (w_set - w)    kf = (R b + K^2) / K

so that, with D = R b + K^2 + kp K = (kf + kp) K,

    w / w_set = 1 / (a2 s^2 + a1 s + 1)    a2 = L J / D    a1 = (R J + L b) / D.

The thesis' table 4.1 pins a2 = 8.68e-4 s^2 and a1 = 0.06497 s. Taking L = 8.68 mH and J = 2e-3 kg m^2 gives D = 0.02;
b = 1e-3 N m s then leaves R = (a1 D - L b) / J = 0.64536 Ohm, and K = 0.1 N m/A leaves
kp = (D - R b - K^2) / K = 0.0935464 V s: a 36 V motor for a cart of about 1.6 kg. By the table, too, the cart
turns 1.00174 times as fast as its set-point: its controller takes the track for 0.174 % wider than it is.

Frames: x ahead at the start, y to the left, heading counter-clockwise from x (REP-103).
"""

import math
from collections.abc import Sequence
from typing import ClassVar, Final

from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel

STEP_SIZE: Final = 0.01

WHEEL_PARAMETERS: Final = (
    Variable("Resistance", "Ohm", 0.64536, Write.STATIC, minimum=1e-3, maximum=100.0),
    Variable("Inductance", "H", 8.68e-3, Write.STATIC, minimum=1e-6, maximum=1.0),
    Variable("Inertia", "kg m2", 2.0e-3, Write.STATIC, minimum=1e-6, maximum=10.0),
    Variable("Friction", "N m s", 1.0e-3, Write.STATIC, minimum=0.0, maximum=10.0),
    Variable("MotorConstant", "N m/A", 0.1, Write.STATIC, minimum=1e-4, maximum=10.0),
    Variable("WheelRadius", "m", 0.05, Write.STATIC, minimum=0.005, maximum=1.0),
    Variable("Track", "m", 0.3, Write.STATIC, minimum=0.02, maximum=5.0),
)
CONTROLLER_PARAMETERS: Final = (
    Variable("FeedbackGain", "V s", 0.0935464, Write.STATIC, minimum=0.0, maximum=10.0, tunable=True),
    Variable("AssumedTrack", "m", 0.300522, Write.STATIC, minimum=0.02, maximum=5.0, tunable=True),
)
SETPOINT_STATES: Final = (
    Variable("LinearSetpoint", "m/s", 0.0, Write.NOW),
    Variable("AngularSetpoint", "rad/s", 0.0, Write.NOW),
)
WHEEL_STATES: Final = (
    Variable("LeftCurrent", "A"),
    Variable("LeftSpeed", "rad/s"),
    Variable("RightCurrent", "A"),
    Variable("RightSpeed", "rad/s"),
    Variable("LeftRotation", "rad"),
    Variable("RightRotation", "rad"),
)
POSE_STATES: Final = (Variable("PoseX", "m"), Variable("PoseY", "m"), Variable("PoseHeading", "rad"))
POSE_OUTPUTS: Final = (
    Variable("X", "m"),
    Variable("Y", "m"),
    Variable("Heading", "rad"),
    Variable("LinearVelocity", "m/s"),
    Variable("AngularVelocity", "rad/s"),
)
WHEEL_OUTPUTS: Final = (
    Variable("LeftAngle", "rad"),
    Variable("RightAngle", "rad"),
    Variable("LeftVelocity", "rad/s"),
    Variable("RightVelocity", "rad/s"),
)


class CartBody(SectionedModel):
    """What rolls: two motors with their wheels, and how their speeds move the cart. A base for models of the cart."""

    method = Method.RUNGE_KUTTA_4

    def static(self) -> None:
        """Gather the parameters as the equations use them."""
        p = self.p
        self.resistance = p["Resistance"]
        self.friction = p["Friction"]
        self.motor_constant = p["MotorConstant"]
        self.per_inductance = 1.0 / p["Inductance"]
        self.per_inertia = 1.0 / p["Inertia"]
        self.half_radius = 0.5 * p["WheelRadius"]
        self.turn = p["WheelRadius"] / p["Track"]

    def velocities(self, left: float, right: float) -> tuple[float, float]:
        """Wheel speeds (rad/s) to the cart's linear (m/s) and angular (rad/s) velocity."""
        return self.half_radius * (left + right), self.turn * (right - left)

    def pose_rates(self, left: float, right: float, heading: float) -> tuple[float, float, float]:
        """Rates of x, y (m/s) and heading (rad/s) at wheel speeds in rad/s."""
        speed, yaw_rate = self.velocities(left, right)
        return speed * math.cos(heading), speed * math.sin(heading), yaw_rate

    def motor_rates(self, voltage: float, current: float, speed: float) -> tuple[float, float]:
        """Rates of a motor's current (A/s) and speed (rad/s2)."""
        return (
            (voltage - self.resistance * current - self.motor_constant * speed) * self.per_inductance,
            (self.motor_constant * current - self.friction * speed) * self.per_inertia,
        )


class _ControlledCart(CartBody):
    """The cart's body with its controller's equations."""

    step_size = STEP_SIZE
    parameters: ClassVar[Sequence[Variable]] = (*WHEEL_PARAMETERS, *CONTROLLER_PARAMETERS)

    def static(self) -> None:
        """Gather the controller's parameters too."""
        super().static()
        p = self.p
        self.kp = p["FeedbackGain"]
        self.kf = (self.resistance * self.friction + self.motor_constant**2) / self.motor_constant
        self.per_radius = 1.0 / p["WheelRadius"]
        self.half_assumed_track = 0.5 * p["AssumedTrack"]

    def voltages(self, linear: float, angular: float, left: float, right: float) -> tuple[float, float]:
        """The controller: set-points (m/s, rad/s) and wheel speeds (rad/s) to motor voltages (V)."""
        kf, kp = self.kf, self.kp
        steer = angular * self.half_assumed_track
        left_set = (linear - steer) * self.per_radius
        right_set = (linear + steer) * self.per_radius
        return kf * left_set + kp * (left_set - left), kf * right_set + kp * (right_set - right)


class Cart(_ControlledCart):
    """The whole case study in one model: wheels, controller and pose, as the thesis simulated it."""

    name = "cart"
    states = (*SETPOINT_STATES, *WHEEL_STATES, *POSE_STATES)
    outputs = (*POSE_OUTPUTS, *WHEEL_OUTPUTS)

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rates of set-points (zero), motors, wheel angles and pose."""
        linear, angular, il, wl, ir, wr, _, _, _, _, heading = s
        vl, vr = self.voltages(linear, angular, wl, wr)
        left, right = self.motor_rates(vl, il, wl), self.motor_rates(vr, ir, wr)
        return (0.0, 0.0, *left, *right, wl, wr, *self.pose_rates(wl, wr, heading))

    def output(self) -> Sequence[float]:
        """Pose, velocities, and the wheels' angles and speeds."""
        _, _, _, wl, _, wr, left, right, x, y, heading = self.s
        return (x, y, heading, *self.velocities(wl, wr), left, right, wl, wr)


class CartController(_ControlledCart):
    """The cart's controller alone, for a cart whose wheels are hardware, with its pose by dead reckoning."""

    name = "cart-controller"
    states: ClassVar[tuple[Variable, ...]] = (*SETPOINT_STATES, *POSE_STATES)
    inputs = (Variable("LeftVelocity", "rad/s"), Variable("RightVelocity", "rad/s"))
    outputs = (*POSE_OUTPUTS, Variable("LeftVoltage", "V"), Variable("RightVoltage", "V"))

    def input(self, u: Sequence[float]) -> None:
        """Take the measured wheel speeds, rad/s."""
        self.left, self.right = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rates of set-points (zero) and pose."""
        return (0.0, 0.0, *self.pose_rates(self.left, self.right, s[4]))

    def output(self) -> Sequence[float]:
        """Pose, velocities, and the motor voltages."""
        linear, angular, x, y, heading = self.s
        velocities = self.velocities(self.left, self.right)
        return (x, y, heading, *velocities, *self.voltages(linear, angular, self.left, self.right))


_DELAY: Final = Variable("Delay", "s", 1.5 * STEP_SIZE, Write.STATIC, minimum=0.0, maximum=0.1)


class CartTorqueController(CartController):
    """The same controller for drives that take torque: it computes the current that its voltage would give.

    Each motor's current follows L di/dt = V - R i - K w, and the torque asked for is K i, so that the wheels move as
    they do behind a voltage. A real motor's K w acts at once; here w is measured in one exchange, and the torque leaves
    in the next and acts until the one after: w is carried on to the middle of that by J dw/dt = K i - b w.
    """

    name = "cart-torque-controller"
    parameters = (*CartController.parameters, _DELAY)
    states = (*SETPOINT_STATES, *POSE_STATES, Variable("LeftCurrent", "A"), Variable("RightCurrent", "A"))
    outputs = (*POSE_OUTPUTS, Variable("LeftTorque", "N m"), Variable("RightTorque", "N m"))

    def static(self) -> None:
        """Gather the delay too."""
        super().static()
        self.delay = self.p["Delay"]

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rates of set-points (zero), pose and currents."""
        linear, angular, _, _, heading, left_current, right_current = s
        left_voltage, right_voltage = self.voltages(linear, angular, self.left, self.right)
        left_rate = self.current_rate(left_voltage, left_current, self.left)
        right_rate = self.current_rate(right_voltage, right_current, self.right)
        return (0.0, 0.0, *self.pose_rates(self.left, self.right, heading), left_rate, right_rate)

    def current_rate(self, voltage: float, current: float, speed: float) -> float:
        """Rate of a motor's current (A/s) at a wheel speed that was measured a while ago (rad/s)."""
        when_it_acts = speed + self.delay * self.motor_rates(voltage, current, speed)[1]
        return self.motor_rates(voltage, current, when_it_acts)[0]

    def output(self) -> Sequence[float]:
        """Pose, velocities, and the torques."""
        _, _, x, y, heading, left_current, right_current = self.s
        torques = (self.motor_constant * left_current, self.motor_constant * right_current)
        return (x, y, heading, *self.velocities(self.left, self.right), *torques)
