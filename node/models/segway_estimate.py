# SPDX-License-Identifier: MIT
"""Where a segway is and how it leans, from its IMU and its encoders.

Pitch is the integral of the gyro, drawn slowly to where the accelerometer feels "up" (a complementary filter: Mahony,
Hamel, Pflimlin, "Nonlinear Complementary Filters on SO(3)", 2008, in one axis, with its estimate of the gyro's bias).
What an accelerometer at a height h above the axle feels along the body, with the axle's acceleration a:

    fx = a cos(pitch) + h d2pitch/dt2 - g sin(pitch)        fz = a sin(pitch) - h (dpitch/dt)^2 + g cos(pitch)

The encoders turn with the body: a wheel has turned by its encoder's angle plus the pitch.

A wheel slips where it turns faster than the robot moves. How fast that is follows from the equation for fx, solved for
a and integrated: the felt velocity. An accelerometer drifts, so this is drawn to what the wheels roll, at first in
proportion to the difference and by 1.3 m/s2 at most: so far off may the accelerometer be and is not taken for slip, and
what was taken for slip wrongly ends. Beyond 0.2 m/s a difference is slip; velocity and travel are without it. Where no
wheel slips all is as the wheels roll, to the last bit. As in ABS and traction control, which compare wheels with a
reference velocity: Gustafsson, "Slip-based tire-road friction estimation", Automatica 33 (1997).

An IMU that fails looks like slip. Slip is looked for only where wheels are given the torque that makes them slip; in
all other phases the law acts on the wheels as they turn, and safety sees at once what the IMU does.
"""

from collections.abc import Mapping
from math import atan2, cos, hypot, sin
from typing import Final

from segway_ecc.firmware_io.value import Value

STANDARD_GRAVITY: Final = 9.80665
_LEAST_GRAVITY: Final = 0.5 * STANDARD_GRAVITY
"""An accelerometer that feels less, m/s2, has sent nothing yet, or falls."""
_STILL_RATE: Final = 0.1
_STILL_SPEED: Final = 0.1
_LARGEST_BIAS: Final = 0.1
_LARGEST_INNOVATION: Final = 0.2
_REST_TIME_S: Final = 0.2
_UNCERTAIN_SPEED: Final = 0.2
"""By how much a wheel may turn too fast, m/s, and is not taken to slip."""
_FELT_TIME_S: Final = 0.15
"""Time constant with which the felt velocity is drawn to the wheels': 0.2 m/s in that time is 1.3 m/s2 at most."""
_LARGEST_ACCELERATION: Final = 2.0 * STANDARD_GRAVITY
"""More, m/s2, no tyre gives: the body hit something, and what the accelerometer feels of that is no travel."""


class SegwayMeasurement(Value, frozen=True):
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


class Estimate(Value, frozen=True):
    """What is known of the robot.

    Attributes:
        since: How long it has been estimated, s; zero before the first acceleration.
        pitch, pitch_rate: Lean, positive forward, rad, and its rate, rad/s.
        pitch_bias, yaw_bias: Offset of the gyro about y, and about the vertical, rad/s.
        rotation: How far the wheels have turned, mean of both, rad.
        travel: How far the axle has come along its way, m.
        velocity: Its rate, m/s.
        yaw_rate: rad/s.
        x, y, heading: Odometry; m, m, rad.
        off: How far the accelerometer's "up" is from the pitch, rad, up to 0.2 either way.
        felt_velocity: The velocity by the accelerometer, drawn to the wheels', m/s.
        left_slip, right_slip: How much faster a wheel turns than the robot moves there, m/s, beyond what is uncertain.
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
    off: float = 0.0
    felt_velocity: float = 0.0
    left_slip: float = 0.0
    right_slip: float = 0.0

    @property
    def rolled(self) -> float:
        """How fast the wheels turn, as if they rolled, m/s."""
        return self.velocity + 0.5 * (self.left_slip + self.right_slip)


class Estimator:
    """Turns what is measured into what is known."""

    def __init__(self, period: float, p: Mapping[str, float]) -> None:
        """Take the parameters `p` of `segway_ecc.node.models.segway`, which has their units, and the period, s."""
        tilt_time, bias_time = p["TiltTime"], p["BiasTime"]
        self._period = period
        self._radius = p["WheelRadius"]
        self._imu_height = p["ImuHeight"]
        self._tilt_time = tilt_time
        self._pull_time = tilt_time * bias_time
        self._half_track = 0.5 * p["Track"]
        self._felt_part = period / _FELT_TIME_S
        self._yaw_rate_per_speed = p["WheelRadius"] / p["Track"]
        self._drawn = period / bias_time
        # The part of a resting gyro's rate that is taken for bias in one period.
        self._settled = period / _REST_TIME_S

    def start(self, m: SegwayMeasurement) -> Estimate:
        """The estimate at rest, from what is measured first; not begun where the accelerometer feels nothing."""
        if hypot(m.acceleration_x, m.acceleration_z) < _LEAST_GRAVITY:
            return Estimate()
        pitch = atan2(-m.acceleration_x, m.acceleration_z)
        return Estimate(since=self._period, pitch=pitch, rotation=_rotation(m, pitch))

    def advance(self, e: Estimate, m: SegwayMeasurement, *, resting: bool, may_slip: bool = False) -> Estimate:
        """The estimate one period later; whether the motors are off, and whether wheels are given enough to slip."""
        since, pitch, pitch_bias = e.since, e.pitch, e.pitch_bias
        if since == 0.0:
            return self.start(m)
        period, cos_pitch, sin_pitch = self._period, cos(pitch), sin(pitch)
        left_velocity, right_velocity = m.left_velocity, m.right_velocity
        pitch_rate = m.gyro_y - pitch_bias
        rolled = self._radius * (0.5 * (left_velocity + right_velocity) + pitch_rate)
        gyro = m.gyro_z * cos_pitch - m.gyro_x * sin_pitch
        felt, left_slip, right_slip = rolled, 0.0, 0.0
        if may_slip:
            felt = self._felt(e, m, pitch_rate, rolled)
            # The left wheel rolls by that much slower than the middle, the right one faster.
            turned = self._half_track * (gyro - e.yaw_bias)
            left_slip = _beyond(self._radius * (left_velocity + pitch_rate) - (felt - turned), _UNCERTAIN_SPEED)
            right_slip = _beyond(self._radius * (right_velocity + pitch_rate) - (felt + turned), _UNCERTAIN_SPEED)
        slips = left_slip != 0.0 or right_slip != 0.0
        velocity = rolled - 0.5 * (left_slip + right_slip)
        still = abs(pitch_rate) < _STILL_RATE and abs(velocity) < _STILL_SPEED

        # How far the accelerometer's "up" is from the estimate, rad, without what the robot's own motion adds.
        rate_before = e.pitch_rate
        ahead = (velocity - e.velocity) / period
        turning = (pitch_rate - rate_before) / period
        fx = m.acceleration_x - ahead * cos_pitch - self._imu_height * turning
        fz = m.acceleration_z - ahead * sin_pitch + self._imu_height * pitch_rate * pitch_rate
        innovation = within(atan2(-fx, fz) - pitch, _LARGEST_INNOVATION)

        tilt_time = _REST_TIME_S if still and resting else self._tilt_time
        pitch += period * (0.5 * (pitch_rate + rate_before) + innovation / tilt_time)
        if still:
            # At rest the gyro should read zero; while it balances, what the accelerometer keeps pulling at is bias.
            pulled = period * innovation / self._pull_time
            bias = pitch_bias + self._settled * pitch_rate if resting else pitch_bias - pulled
            pitch_bias = within(bias, _LARGEST_BIAS)
        wheels = self._yaw_rate_per_speed * (right_velocity - left_velocity)
        yaw_rate, yaw_bias = self._yaw(gyro, wheels, e.yaw_bias, still_at_rest=still and resting)

        rotation = _rotation(m, pitch)
        step = period * velocity if slips else self._radius * (rotation - e.rotation)
        heading = e.heading + period * yaw_rate
        middle = 0.5 * (e.heading + heading)
        return Estimate(  # in the order of the fields: by their names takes four times as long
            since + period,
            pitch,
            pitch_rate,
            pitch_bias,
            yaw_bias,
            rotation,
            e.travel + step,
            velocity,
            yaw_rate,
            e.x + step * cos(middle),
            e.y + step * sin(middle),
            heading,
            innovation,
            felt,
            left_slip,
            right_slip,
        )

    def _felt(self, e: Estimate, m: SegwayMeasurement, pitch_rate: float, rolled: float) -> float:
        """The felt velocity one period later, where the wheels roll at `rolled`, m/s."""
        turning = (pitch_rate - e.pitch_rate) / self._period
        ahead = (m.acceleration_x + STANDARD_GRAVITY * sin(e.pitch) - self._imu_height * turning) / cos(e.pitch)
        if abs(ahead) > _LARGEST_ACCELERATION:
            return rolled
        felt = e.felt_velocity + self._period * ahead
        return felt + self._felt_part * within(rolled - felt, _UNCERTAIN_SPEED)

    def _yaw(self, gyro: float, wheels: float, bias: float, *, still_at_rest: bool) -> tuple[float, float]:
        """Yaw rate and the bias of the gyro about the vertical: the gyro knows the short run, the wheels the long."""
        yaw_rate = gyro - bias
        if still_at_rest and abs(yaw_rate) < _STILL_RATE:
            return 0.0, within(bias + self._settled * yaw_rate, _LARGEST_BIAS)
        return yaw_rate, within(bias + self._drawn * within(yaw_rate - wheels, _LARGEST_BIAS), _LARGEST_BIAS)


def _rotation(m: SegwayMeasurement, pitch: float) -> float:
    return 0.5 * (m.left_angle + m.right_angle) + pitch


def _beyond(value: float, limit: float) -> float:
    """By how much a value is outside of minus to plus the limit."""
    return value - within(value, limit)


def within(value: float, limit: float) -> float:
    """The nearest value to this one from minus to plus the limit."""
    # The comparison that mostly holds takes a third of the time of what it saves.
    return value if -limit <= value <= limit else min(max(value, -limit), limit)
