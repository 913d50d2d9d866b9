"""How a segway is kept up and moved: set-points that its body can follow, and the torques that follow them.

The balance is state feedback with the gains that `segway-ecc design` finds, around a reference that moves as asked:

    u = u_ref - k1 (travel - travel_ref) - k2 (velocity - velocity_ref) - k3 (pitch - pitch_ref) - k4 pitch_rate
              - k5 (u[-1] - u_ref) - k6 (u[-2] - u_ref) - k7 integral of (travel - travel_ref)

with u the sum of both wheels' torques and u[-1], u[-2] those on their way to the motors. To speed up by a, the body
leans pitch_ref = PitchPerAcceleration a and the wheels push u_ref = TorquePerAcceleration a (in the linear model, with
the pitch at rest). The heading is held by feedback of its error and of the yaw rate on the difference of the torques.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from node.models.segway_estimate import Estimate

_RAMP_RATE: Final = 2.0
_RAMP_LAG_S: Final = 0.2
"""The ramp of a set-point is (1 + lag s) s + rate: well damped, and without a step in acceleration."""


class Motion(NamedTuple):
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


class Torques(NamedTuple):
    """What each wheel is to push, N m."""

    left: float
    right: float


@dataclass(frozen=True, slots=True)
class Law:
    """The controller's equations with its parameters `p`; see `node.models.segway` for their names and units."""

    period: float
    p: Mapping[str, float]

    def ramped(self, motion: Motion, e: Estimate, linear: float, angular: float) -> Motion:
        """Move the reference for one period towards the set-points, m/s and rad/s, not further ahead than allowed."""
        p = self.p
        linear, angular = _within(linear, p["MaxSpeed"]), _within(angular, p["MaxYawRate"])
        velocity, acceleration = self._ramp(motion.velocity, motion.acceleration, linear, p["MaxAcceleration"])
        yaw_rate, yaw_acceleration = self._ramp(
            motion.yaw_rate, motion.yaw_acceleration, angular, p["MaxYawAcceleration"]
        )
        travel = _near(motion.travel + self.period * velocity, e.travel, p["MaxTravelError"])
        heading = _near(motion.heading + self.period * yaw_rate, e.heading, p["MaxHeadingError"])
        return Motion(
            travel=travel,
            velocity=velocity,
            acceleration=acceleration,
            heading=heading,
            yaw_rate=yaw_rate,
            yaw_acceleration=yaw_acceleration,
            integral=motion.integral,
            sent=motion.sent,
            sent_before=motion.sent_before,
            turning=motion.turning,
        )

    def _ramp(self, rate: float, acceleration: float, wanted: float, limit: float) -> tuple[float, float]:
        asked = _within(_RAMP_RATE * (wanted - rate), limit)
        acceleration += self.period / _RAMP_LAG_S * (asked - acceleration)
        return rate + self.period * acceleration, acceleration

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
        p = self.p
        ahead = p["TorquePerAcceleration"] * motion.acceleration
        error = e.travel - motion.travel
        u = (
            ahead
            - p["TravelGain"] * error
            - p["VelocityGain"] * (e.velocity - motion.velocity)
            - p["PitchGain"] * (e.pitch - p["PitchPerAcceleration"] * motion.acceleration)
            - p["PitchRateGain"] * e.pitch_rate
            - p["SentGain"] * (motion.sent - ahead)
            - p["SentBeforeGain"] * (motion.sent_before - ahead)
            - p["IntegralGain"] * motion.integral
        )
        sent = self._reachable(u, motion.sent, 2.0 * limit)
        # What cannot be sent is no reason to ask for more: the integral waits.
        integral = motion.integral if sent != u else motion.integral + self.period * error
        turning = self._turning(motion, e, limit, sent)
        return motion._replace(
            integral=_within(integral, p["MaxIntegral"]), sent=sent, sent_before=motion.sent, turning=turning
        )

    def braked(self, motion: Motion, torque: float, limit: float) -> Motion:
        """Send a sum of torques, N m, and hold no heading."""
        sent = self._reachable(torque, motion.sent, 2.0 * limit)
        return motion._replace(sent=sent, sent_before=motion.sent, turning=0.0)

    def _reachable(self, torque: float, sent: float, limit: float) -> float:
        """The nearest torque that the motors can give, and that is not too far from the one before."""
        step = self.p["TorqueSlew"] * self.period
        return _within(_near(torque, sent, step), limit)

    def _turning(self, motion: Motion, e: Estimate, limit: float, sent: float) -> float:
        """Difference of torques, right less left: balance comes first, and turning has what it leaves."""
        p = self.p
        wanted = (
            p["TorquePerYawAcceleration"] * motion.yaw_acceleration
            - p["HeadingGain"] * (e.heading - motion.heading)
            - p["YawRateGain"] * (e.yaw_rate - motion.yaw_rate)
        )
        return _within(wanted, min(p["MaxTurningTorque"], 2.0 * limit - abs(sent)))


def torques(motion: Motion) -> Torques:
    """What was sent last, wheel by wheel."""
    return Torques(0.5 * (motion.sent - motion.turning), 0.5 * (motion.sent + motion.turning))


def stopped(motion: Motion) -> Motion:
    """Send nothing."""
    return motion._replace(sent=0.0, sent_before=motion.sent, turning=0.0, integral=0.0)


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _near(value: float, centre: float, distance: float) -> float:
    return min(max(value, centre - distance), centre + distance)
