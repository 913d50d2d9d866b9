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

An IMU that fails looks like slip. By what is felt, slip is looked for only where wheels are given the torque that makes
them slip. While it balances, the body itself shows how the axle moves, whatever the ground does to the wheels: what
the ground gives passes through the axle and has no moment about it. With the torque T of both wheels,

    J dq/dt + m l a cos(pitch) = m g l sin(pitch) - T        a = (g sin(pitch) - T / (m l) - L dq/dt) / cos(pitch)

where L = J / (m l), SwingLength, is how high above the axle a blow leaves the axle at rest, and 1 / (m l) follows from
the gains for a steady acceleration: m l g PitchPerAcceleration = m l + TorquePerAcceleration. A blow that stops the
axle turns the body, and in one sample both are known. It is used while a wheel is not to be believed, which the wheels
must show by themselves: one gains speed as its torque gives to none that carries the robot, and as the body does not
show; or both lose some of it as the body shows that the axle was stopped. Until both wheels roll again, and no longer
than 0.5 s, the axle goes as the body shows, drawn to the wheel that is nearer to it.

Both wheels spin so where the robot slips, leaps or is lifted. What tells them apart is Newton's second law: an
accelerometer feels all forces on the body but its weight. A body that leaps feels none, one that stands or is held
feels its weight. Wheels that slip on a floor are held by it, and bounce in turns. So where both have spun alike for
0.02 s, or for half of it with less torque than makes them slip, and the body feels half to twice its weight all the
while, something other than its wheels carries it: a hand (`lifted`).
"""

from collections.abc import Mapping
from math import atan2, copysign, cos, hypot, sin
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
_OFF_TIME_S: Final = 0.1
"""Time constant of the mean of what "up" is off: noise may be three times as much as that of the published sensors."""
_UNCERTAIN_SPEED: Final = 0.2
"""By how much a wheel may turn too fast, m/s, and is not taken to slip."""
_FELT_TIME_S: Final = 0.15
"""Time constant with which the felt velocity is drawn to the wheels': 0.2 m/s in that time is 1.3 m/s2 at most."""
_LARGEST_ACCELERATION: Final = 2.0 * STANDARD_GRAVITY
"""More, m/s2, no tyre gives: the body hit something, and what the accelerometer feels of that is no travel."""
_FREE: Final = 12.0
_FREE_PER_TORQUE: Final = 15.0
"""A wheel that gains more speed than 12 m/s2, and 15 m/s2 for each N m that both are given, has no floor: those that
carry the published robot gain 14 m/s2 for each N m, and those in the air 145 m/s2."""
_PUSHED_STILL: Final = 0.8
"""Of a torque so much counts a period later: it acts for two or three after it was sent."""
_OFF_SHARE: Final = 0.5
"""By this part of what it gains, the momentum is off at least."""
_JUMP: Final = 3.0 * STANDARD_GRAVITY
"""What changes the momentum faster, m/s2, is no motion of the robot: friction gives 1 g, a push 1.4 g."""
_LOST_SHARE: Final = 0.1
"""Wheels lose at least this part of what the axle does by a blow, in the sample that shows it: their speed is filtered,
and one may be in the air."""
_LONGEST_FREE_S: Final = 0.5
"""How long wheels may not be believed, s: to climb an edge of 1 cm takes 0.3 s. Then they are believed again."""
_DRAWN_TO_WHEELS: Final = 3.0
"""How fast that is drawn to the wheels, m/s2: more than what wrong pitch, torque and payload add up to."""
_ALIKE: Final = 0.8
"""Wheels spin alike that differ by less than this part of the faster one's: at an edge they bounce in turns."""
_HARDLY: Final = 20.0
"""Which of two wheels that both gain less, m/s2, does so faster means nothing."""
_STEADY: Final = 6.0
"""Wheels that gain less, m/s2, may roll, and what looks like a slip be a velocity that was felt wrongly."""
_LEAST_HELD: Final = 0.5 * STANDARD_GRAVITY
_MOST_HELD: Final = 2.0 * STANDARD_GRAVITY
"""A body that feels less, m/s2, falls freely; one that feels more was struck by the floor, and not lifted."""
_LEAST_SLIP_TORQUE: Final = 0.6
"""Sum of torques, N m, with which the published robot slips on a friction of 0.23, by M g r: a floor carries it."""
_SURE: Final = 2.0
"""So many times a moment counts in which wheels spin with less than that."""
_LEAST_LEAN: Final = 1.02
"""PitchPerAcceleration times gravity is more than one for any robot; nearer to it the wheels weigh next to nothing."""
_LEAST_PER_ACCELERATION: Final = 1e-3
"""TorquePerAcceleration is more for any robot, N m s2/m."""


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
        off: How far the accelerometer's "up" is from the pitch, rad, in the mean and up to 0.2 either way.
        felt_velocity: The velocity by the accelerometer, drawn to the wheels', m/s.
        left_slip, right_slip: How much faster a wheel turns than the robot moves there, m/s, beyond what is uncertain.
        left_tread, right_tread: Velocity of each wheel's tread against the body, m/s.
        free: How long a wheel has been without the floor, or stopped by an edge, s; zero while both roll.
        lifted: How long both have been, alike, while something else carries the body, s; sure moments count twice.
        pushed: The largest sum of torques that may act still, either way, N m.
        falling: How long the body has felt less than half its weight while a wheel has no floor, s.
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
    left_tread: float = 0.0
    right_tread: float = 0.0
    free: float = 0.0
    lifted: float = 0.0
    pushed: float = 0.0
    falling: float = 0.0

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
        lean = max(p["PitchPerAcceleration"] * STANDARD_GRAVITY, _LEAST_LEAN)
        self._swing = p["SwingLength"]
        self._per_moment = (lean - 1.0) / max(p["TorquePerAcceleration"], _LEAST_PER_ACCELERATION)
        self._hardly, self._steady = _HARDLY * period, _STEADY * period
        self._jump, self._drawn_most = _JUMP * period, _DRAWN_TO_WHEELS * period
        self._yaw_rate_per_speed = p["WheelRadius"] / p["Track"]
        self._drawn = period / bias_time
        # The part of a resting gyro's rate that is taken for bias in one period.
        self._settled = period / _REST_TIME_S
        self._off_part = period / _OFF_TIME_S

    def start(self, m: SegwayMeasurement) -> Estimate:
        """The estimate at rest, from what is measured first; not begun where the accelerometer feels nothing."""
        if hypot(m.acceleration_x, m.acceleration_z) < _LEAST_GRAVITY:
            return Estimate()
        pitch = atan2(-m.acceleration_x, m.acceleration_z)
        return Estimate(since=self._period, pitch=pitch, rotation=_rotation(m, pitch))

    def advance(
        self, e: Estimate, m: SegwayMeasurement, *, resting: bool, may_slip: bool = False, sent: float | None = None
    ) -> Estimate:
        """The estimate one period later.

        Args:
            e: The estimate now.
            m: What is measured.
            resting: Whether the motors are off.
            may_slip: Whether wheels are given enough torque to slip.
            sent: Sum of the torques that were sent last, N m, where the robot balances.
        """
        since, pitch, pitch_bias = e.since, e.pitch, e.pitch_bias
        if since == 0.0:
            return self.start(m)
        period, cos_pitch, sin_pitch = self._period, cos(pitch), sin(pitch)
        left_velocity, right_velocity = m.left_velocity, m.right_velocity
        pitch_rate = m.gyro_y - pitch_bias
        rolled = self._radius * (0.5 * (left_velocity + right_velocity) + pitch_rate)
        gyro = m.gyro_z * cos_pitch - m.gyro_x * sin_pitch
        left_tread, right_tread = self._radius * left_velocity, self._radius * right_velocity
        felt, free, left_slip, right_slip, pushed = rolled, 0.0, 0.0, 0.0, 0.0
        if may_slip or sent is not None:
            # The left wheel rolls by that much slower than the middle, the right one faster.
            turned, rolling = self._half_track * (gyro - e.yaw_bias), self._radius * pitch_rate
            left, right = left_tread + rolling + turned, right_tread + rolling - turned
            if sent is None:
                felt = self._felt(e, m, pitch_rate, rolled)
            else:
                pushed = max(abs(sent), _PUSHED_STILL * e.pushed)
                fall = period * (STANDARD_GRAVITY * sin_pitch - sent * self._per_moment)
                swung = (fall - self._swing * (pitch_rate - e.pitch_rate)) / cos_pitch
                kept = e.felt_velocity + swung
                off = left - kept, right - kept
                free = self._freed(e, (left_tread, right_tread), off, copysign(pushed, sent), swung)
                # While the wheels are believed, so fast that a late IMU leaves nothing behind.
                felt = kept + within(min(off, key=abs), self._drawn_most if free else _FREE * period)
            if may_slip or free:
                left_slip, right_slip = _beyond(left - felt, _UNCERTAIN_SPEED), _beyond(right - felt, _UNCERTAIN_SPEED)
        slips = left_slip != 0.0 or right_slip != 0.0
        lifted = falling = 0.0
        if free:
            lifted = self._lifted(e, m, (left_tread, right_tread), (left_slip, right_slip), pushed)
            falling = e.falling + period if hypot(m.acceleration_x, m.acceleration_z) < _LEAST_HELD else 0.0
        velocity = felt if free else rolled - 0.5 * (left_slip + right_slip)
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
        step = period * velocity if slips or free else self._radius * (rotation - e.rotation)
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
            e.off + self._off_part * (innovation - e.off),
            felt,
            left_slip,
            right_slip,
            left_tread,
            right_tread,
            free,
            lifted,
            pushed,
            falling,
        )

    def _freed(
        self, e: Estimate, treads: tuple[float, float], off: tuple[float, float], sent: float, swung: float
    ) -> float:
        """How long a wheel has been without the floor, or stopped, s.

        Args:
            e: The estimate before.
            treads: Velocities of both treads against the body, m/s.
            off: By how much the axle is off if the left wheel rolls, and if the right one does, m/s.
            sent: Sum of the torques that act on them, N m.
            swung: By how much faster than before the body shows the axle to be, m/s.
        """
        left_off, right_off = off
        if e.free:
            jump = self._jump
            rolls = -jump < left_off < jump and -jump < right_off < jump
            return e.free + self._period if e.free < _LONGEST_FREE_S and not rolls else 0.0
        left, right = treads[0] - e.left_tread, treads[1] - e.right_tread
        most = self._period * (_FREE + _FREE_PER_TORQUE * abs(sent))
        back = -copysign(1.0, e.velocity)
        if back * swung > most and 0.5 * (left + right) * back > _LOST_SHARE * back * swung:  # it was stopped
            return self._period
        way = copysign(1.0, sent)
        left, right = way * left, way * right
        if left <= most and right <= most:  # nearly always
            return 0.0
        left_spins = left > most and way * left_off > _OFF_SHARE * left
        right_spins = right > most and way * right_off > _OFF_SHARE * right
        return self._period if left_spins or right_spins else 0.0

    def _lifted(
        self,
        e: Estimate,
        m: SegwayMeasurement,
        treads: tuple[float, float],
        slips: tuple[float, float],
        pushed: float,
    ) -> float:
        """How long both wheels have spun alike while something carries the body, s.

        Treads and slips are in m/s, the torque by which they are `pushed` in N m.
        """
        gains = treads[0] - e.left_tread, treads[1] - e.right_tread
        gain = max(abs(gains[0]), abs(gains[1]))
        spin = slips[0] * treads[0] > 0.0 and slips[1] * treads[1] > 0.0 and _are_alike(slips)
        if not (spin and _is_held(m) and (gain < self._hardly or _are_alike(gains))):
            return 0.0
        if gain <= self._steady:
            return e.lifted
        return e.lifted + self._period * (1.0 if pushed > _LEAST_SLIP_TORQUE else _SURE)

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


def _is_held(m: SegwayMeasurement) -> bool:
    """Whether something carries the body, by what it feels."""
    return _LEAST_HELD < hypot(m.acceleration_x, m.acceleration_z) < _MOST_HELD


def _are_alike(speeds: tuple[float, float]) -> bool:
    """Whether these are of two wheels that are given alike and that nothing holds, m/s."""
    left, right = speeds
    return abs(left - right) < _ALIKE * max(abs(left), abs(right))


def _beyond(value: float, limit: float) -> float:
    """By how much a value is outside of minus to plus the limit."""
    return value - within(value, limit)


def within(value: float, limit: float) -> float:
    """The nearest value to this one from minus to plus the limit."""
    # The comparison that mostly holds takes a third of the time of what it saves.
    return value if -limit <= value <= limit else min(max(value, -limit), limit)
