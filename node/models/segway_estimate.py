"""Where a segway is and how it leans, from its IMU and its encoders.

Pitch is the integral of the gyro, drawn slowly to where the accelerometer feels "up" (a complementary filter: Mahony,
Hamel, Pflimlin, "Nonlinear Complementary Filters on SO(3)", 2008, in one axis, with its estimate of the gyro's bias).
What an accelerometer at a height h above the axle feels along the body, with the axle's acceleration a:

    fx = a cos(pitch) + h d2pitch/dt2 - g sin(pitch)        fz = a sin(pitch) - h (dpitch/dt)^2 + g cos(pitch)

The encoders turn with the body: a wheel has turned by its encoder's angle plus the pitch.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

STANDARD_GRAVITY: Final = 9.80665
_LEAST_GRAVITY: Final = 0.5 * STANDARD_GRAVITY
"""An accelerometer that feels less, m/s2, has not been heard yet, or falls."""
_STILL_RATE: Final = 0.1
_STILL_SPEED: Final = 0.1
_LARGEST_BIAS: Final = 0.1
_LARGEST_INNOVATION: Final = 0.2
_REST_TIME_S: Final = 0.2


class Measured(NamedTuple):
    """What is measured: encoders (rad, rad/s), gyro (rad/s) and accelerometer (m/s2)."""

    left_angle: float
    left_velocity: float
    right_angle: float
    right_velocity: float
    gyro_x: float
    gyro_y: float
    gyro_z: float
    acceleration_x: float
    acceleration_y: float
    acceleration_z: float


class Estimate(NamedTuple):
    """What is known of the robot.

    Attributes:
        since: How long it has been estimated, s; zero until the accelerometer was heard.
        pitch: Lean, positive forward, rad.
        pitch_rate: Its rate, rad/s.
        pitch_bias: What the gyro says too much about y, rad/s.
        yaw_bias: The same about the vertical, rad/s.
        rotation: How far the wheels have turned, mean of both, rad.
        travel: How far the axle has come along its way, m.
        velocity: Its rate, m/s.
        yaw_rate: rad/s.
        x: Odometry, m.
        y: Odometry, m.
        heading: Odometry, rad.
    """

    since: float = 0.0
    pitch: float = 0.0
    pitch_rate: float = 0.0
    pitch_bias: float = 0.0
    yaw_bias: float = 0.0
    rotation: float = 0.0
    travel: float = 0.0
    velocity: float = 0.0
    yaw_rate: float = 0.0
    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0


@dataclass(frozen=True, slots=True)
class Estimator:
    """Turns what is measured into what is known.

    Attributes:
        period: Time between two measurements, s.
        radius: Of the wheels, m.
        track: Between the wheels, m.
        imu_height: Of the IMU above the axle, along the body, m.
        tilt_time: How slowly the pitch follows the accelerometer, s.
        bias_time: How slowly the biases follow, s.
    """

    period: float
    radius: float
    track: float
    imu_height: float
    tilt_time: float
    bias_time: float

    def start(self, m: Measured) -> Estimate:
        """The estimate at rest, from what is measured first; not begun where the accelerometer feels nothing."""
        if math.hypot(m.acceleration_x, m.acceleration_z) < _LEAST_GRAVITY:
            return Estimate()
        pitch = math.atan2(-m.acceleration_x, m.acceleration_z)
        return Estimate(since=self.period, pitch=pitch, rotation=_rotation(m, pitch))

    def advance(self, e: Estimate, m: Measured, *, resting: bool) -> Estimate:
        """The estimate one period later; `resting` says that the motors are off."""
        if e.since == 0.0:
            return self.start(m)
        rate = m.gyro_y - e.pitch_bias
        velocity = self.radius * (0.5 * (m.left_velocity + m.right_velocity) + rate)
        innovation = self._innovation(e, m, rate, velocity)
        still = abs(rate) < _STILL_RATE and abs(velocity) < _STILL_SPEED
        tilt_time = _REST_TIME_S if still and resting else self.tilt_time
        pitch = e.pitch + self.period * (0.5 * (rate + e.pitch_rate) + innovation / tilt_time)
        pitch_bias = self._pitch_bias(e, m, innovation, resting=resting) if still else e.pitch_bias
        yaw_rate, yaw_bias = self._yaw(e, m, still_at_rest=still and resting)
        rotation = _rotation(m, pitch)
        step = self.radius * (rotation - e.rotation)
        heading = e.heading + self.period * yaw_rate
        middle = 0.5 * (e.heading + heading)
        return Estimate(
            since=e.since + self.period,
            pitch=pitch,
            pitch_rate=rate,
            pitch_bias=pitch_bias,
            yaw_bias=yaw_bias,
            rotation=rotation,
            travel=e.travel + step,
            velocity=velocity,
            yaw_rate=yaw_rate,
            x=e.x + step * math.cos(middle),
            y=e.y + step * math.sin(middle),
            heading=heading,
        )

    def _innovation(self, e: Estimate, m: Measured, rate: float, velocity: float) -> float:
        """How far the accelerometer's "up" is from the estimate, rad, without what the robot's own motion adds."""
        ahead = (velocity - e.velocity) / self.period
        turning = (rate - e.pitch_rate) / self.period
        fx = m.acceleration_x - ahead * math.cos(e.pitch) - self.imu_height * turning
        fz = m.acceleration_z - ahead * math.sin(e.pitch) + self.imu_height * rate * rate
        return _within(math.atan2(-fx, fz) - e.pitch, _LARGEST_INNOVATION)

    def _pitch_bias(self, e: Estimate, m: Measured, innovation: float, *, resting: bool) -> float:
        """At rest the gyro should say zero; while it balances, what the accelerometer keeps pulling at is bias."""
        pulled = self.period * innovation / (self.tilt_time * self.bias_time)
        bias = e.pitch_bias + self._settled(m.gyro_y, e.pitch_bias) if resting else e.pitch_bias - pulled
        return _within(bias, _LARGEST_BIAS)

    def _yaw(self, e: Estimate, m: Measured, *, still_at_rest: bool) -> tuple[float, float]:
        """Yaw rate and the bias of the gyro about the vertical: the gyro knows the short run, the wheels the long."""
        gyro = m.gyro_z * math.cos(e.pitch) - m.gyro_x * math.sin(e.pitch)
        if still_at_rest and abs(gyro - e.yaw_bias) < _STILL_RATE:
            return 0.0, _within(e.yaw_bias + self._settled(gyro, e.yaw_bias), _LARGEST_BIAS)
        yaw_rate = gyro - e.yaw_bias
        wheels = self.radius / self.track * (m.right_velocity - m.left_velocity)
        drawn = self.period / self.bias_time * _within(yaw_rate - wheels, _LARGEST_BIAS)
        return yaw_rate, _within(e.yaw_bias + drawn, _LARGEST_BIAS)

    def _settled(self, value: float, bias: float) -> float:
        """How much of what a resting gyro says is taken for bias in one period, rad/s."""
        return self.period / _REST_TIME_S * (value - bias)


def _rotation(m: Measured, pitch: float) -> float:
    return 0.5 * (m.left_angle + m.right_angle) + pitch


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
