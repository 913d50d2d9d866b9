# SPDX-License-Identifier: MIT
"""How a segway is kept up and moved: set-points that its body can follow, and the torques that follow them.

The balance is state feedback with the gains that `segway-ecc design gains` finds, around a moving reference:

    u = u_ref - k1 (travel - travel_ref) - k2 (velocity - velocity_ref) - k3 (pitch - pitch_ref) - k4 pitch_rate
              - k5 (u[-1] - u_ref) - k6 (u[-2] - u_ref) - k7 integral of (travel - travel_ref)

with u the sum of both wheels' torques and u[-1], u[-2] those on their way to the motors. To speed up by a, the body
leans pitch_ref = PitchPerAcceleration a and the wheels push u_ref = TorquePerAcceleration a (in the linear model, with
the pitch at rest). The heading is held by feedback of its error and of the yaw rate on the difference of the torques.
"""

from collections.abc import Mapping
from typing import Final

from msgspec.structs import replace

from segway_ecc.firmware_io.value import Value
from segway_ecc.node.models.segway_estimate import Estimate, within

_RAMP_RATE: Final = 2.0
_RAMP_LAG_S: Final = 0.2
"""The ramp of a set-point is (1 + lag s) s + rate: well damped, and without a step in acceleration."""


class Motion(Value, frozen=True):
    """Where the robot should be, and what was sent to get it there.

    Attributes:
        travel: Reference of the travel, m.
        velocity: Its rate, m/s.
        acceleration: Its rate, m/s2.
        heading: Reference of the heading, rad.
        yaw_rate: Its rate, rad/s.
        yaw_acceleration: Its rate, rad/s2.
        integral: Integral of the travel's error, m s.
        sent: Sum of the torques sent last, N m.
        sent_before: The one before.
        turning: Difference of the torques sent last, N m.
    """

    travel: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    heading: float = 0.0
    yaw_rate: float = 0.0
    yaw_acceleration: float = 0.0
    integral: float = 0.0
    sent: float = 0.0
    sent_before: float = 0.0
    turning: float = 0.0


Torques = tuple[float, float]
"""What the left and the right wheel are to push, N m."""


class Law:
    """The controller's equations with its parameters."""

    def __init__(self, period: float, p: Mapping[str, float]) -> None:
        """Take the parameters `p` of `segway_ecc.node.models.segway`, which has their units, and the period, s."""
        self._period = period
        self._ramp_part = period / _RAMP_LAG_S
        self._torque_step = p["TorqueSlew"] * period
        self._travel_gain = p["TravelGain"]
        self._velocity_gain = p["VelocityGain"]
        self._pitch_gain = p["PitchGain"]
        self._pitch_rate_gain = p["PitchRateGain"]
        self._sent_gain = p["SentGain"]
        self._sent_before_gain = p["SentBeforeGain"]
        self._integral_gain = p["IntegralGain"]
        self._pitch_per_acceleration = p["PitchPerAcceleration"]
        self._torque_per_acceleration = p["TorquePerAcceleration"]
        self._heading_gain = p["HeadingGain"]
        self._yaw_rate_gain = p["YawRateGain"]
        self._torque_per_yaw_acceleration = p["TorquePerYawAcceleration"]
        self._max_speed = p["MaxSpeed"]
        self._max_acceleration = p["MaxAcceleration"]
        self._max_yaw_rate = p["MaxYawRate"]
        self._max_yaw_acceleration = p["MaxYawAcceleration"]
        self._max_travel_error = p["MaxTravelError"]
        self._max_heading_error = p["MaxHeadingError"]
        self._max_integral = p["MaxIntegral"]
        self._max_turning_torque = p["MaxTurningTorque"]

    def ramped(self, motion: Motion, e: Estimate, linear: float, angular: float) -> Motion:
        """Move the reference for one period towards the set-points, m/s and rad/s, not further ahead than allowed."""
        linear, angular = within(linear, self._max_speed), within(angular, self._max_yaw_rate)
        velocity, acceleration = self._ramp(motion.velocity, motion.acceleration, linear, self._max_acceleration)
        yaw_rate, yaw_acceleration = self._ramp(
            motion.yaw_rate, motion.yaw_acceleration, angular, self._max_yaw_acceleration
        )
        return replace(
            motion,
            travel=_near(motion.travel + self._period * velocity, e.travel, self._max_travel_error),
            velocity=velocity,
            acceleration=acceleration,
            heading=_near(motion.heading + self._period * yaw_rate, e.heading, self._max_heading_error),
            yaw_rate=yaw_rate,
            yaw_acceleration=yaw_acceleration,
        )

    def _ramp(self, rate: float, acceleration: float, wanted: float, limit: float) -> tuple[float, float]:
        asked = within(_RAMP_RATE * (wanted - rate), limit)
        acceleration += self._ramp_part * (asked - acceleration)
        return rate + self._period * acceleration, acceleration

    def here(self, motion: Motion, e: Estimate) -> Motion:
        """A reference that is where the robot is, at rest; what was sent is kept."""
        return Motion(
            travel=e.travel,
            heading=e.heading,
            sent=motion.sent,
            sent_before=motion.sent_before,
            turning=motion.turning,
        )

    def balanced(self, motion: Motion, e: Estimate, limit: float) -> Motion:
        """Send what keeps the robot up and on its way, each wheel within `limit`, N m."""
        acceleration, integral, last = motion.acceleration, motion.integral, motion.sent
        ahead = self._torque_per_acceleration * acceleration
        error = e.travel - motion.travel
        u = (
            ahead
            - self._travel_gain * error
            - self._velocity_gain * (e.velocity - motion.velocity)
            - self._pitch_gain * (e.pitch - self._pitch_per_acceleration * acceleration)
            - self._pitch_rate_gain * e.pitch_rate
            - self._sent_gain * (last - ahead)
            - self._sent_before_gain * (motion.sent_before - ahead)
            - self._integral_gain * integral
        )
        sent = self._reachable(u, last, 2.0 * limit)
        if sent == u:  # what cannot be sent is no reason to ask for more: the integral waits
            integral += self._period * error
        return replace(
            motion,
            integral=within(integral, self._max_integral),
            sent=sent,
            sent_before=last,
            turning=self._turning(motion, e, limit, sent),
        )

    def braked(self, motion: Motion, torque: float, limit: float) -> Motion:
        """Send a sum of torques, N m, and hold no heading."""
        sent = self._reachable(torque, motion.sent, 2.0 * limit)
        return replace(motion, sent=sent, sent_before=motion.sent, turning=0.0)

    def _reachable(self, torque: float, sent: float, limit: float) -> float:
        """The nearest torque that the motors can give, and that is not too far from the one before."""
        return within(_near(torque, sent, self._torque_step), limit)

    def _turning(self, motion: Motion, e: Estimate, limit: float, sent: float) -> float:
        """Difference of torques, right less left: balance comes first, and turning has what it leaves."""
        wanted = (
            self._torque_per_yaw_acceleration * motion.yaw_acceleration
            - self._heading_gain * (e.heading - motion.heading)
            - self._yaw_rate_gain * (e.yaw_rate - motion.yaw_rate)
        )
        return within(wanted, min(self._max_turning_torque, 2.0 * limit - abs(sent)))


def torques(motion: Motion) -> Torques:
    """What was sent last, wheel by wheel."""
    sent, turning = motion.sent, motion.turning
    return 0.5 * (sent - turning), 0.5 * (sent + turning)


def stopped(motion: Motion) -> Motion:
    """Send nothing."""
    return replace(motion, sent=0.0, sent_before=motion.sent, turning=0.0, integral=0.0)


def _near(value: float, centre: float, distance: float) -> float:
    low, high = centre - distance, centre + distance
    return value if low <= value <= high else min(max(value, low), high)
