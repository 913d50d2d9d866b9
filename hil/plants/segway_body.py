# SPDX-License-Identifier: MIT
"""How the segway moves: a body on two wheels that roll without slipping, by Lagrange's method.

Coordinates: way s along the ground (rate v), lean b of the body against the ground's normal (rate q), heading (rate w,
about the ground's normal). The ground rises ahead by the slope a, wherever ahead is, and pitch = b - a is the lean
against the vertical. Mass m of the body with its payload, its centre l above the axle along the body, inertias Ix, Iy,
Iz about that centre, wheels of mass mw and inertias Iw (spin) and Id (diameter), radius r, track d.

Kinetic energy, with the speed of the body's centre (v + l q cos b, w l sin b, -l q sin b) ahead, left and up:

    T = M v^2 / 2 + m l v q cos b + J q^2 / 2 + Y(b) w^2 / 2
    M = m + 2 mw + 2 Iw / r^2            J = m l^2 + Iy
    Y(b) = Iz + 2 Id + (mw + Iw / r^2) d^2 / 2 + D sin^2 b       D = m l^2 + Ix - Iz

Potential energy: m g l cos(b - a) + (m + 2 mw) g s sin a. The wheels cannot slip sideways, so v and w are
quasi-velocities, for which Lagrange's equations take the form of Boltzmann and Hamel: with the sideways momentum
p = m l w sin b, the first gets -w p and the third +v p. With wheel torques TL, TR (on the wheel, against the body):

    M v' + m l cos b q' = m l (q^2 + w^2) sin b - (m + 2 mw) g sin a + (TL + TR) / r + F cos a
    m l cos b v' + J q' = D w^2 sin b cos b + m g l sin(b - a) - TL - TR + F l cos(b - a)
    Y w' = -2 D q w sin b cos b - m l v w sin b + (TR - TL) d / (2 r)

F is a horizontal push at the centre of mass, along the heading. These are the equations of K. Pathak, J. Franch, S. K.
Agrawal, "Velocity and position control of a wheeled inverted pendulum by partial feedback linearization", IEEE
Transactions on Robotics 21(3), 2005, and of S. Kim, S. Kwon, "Dynamic modeling of a two-wheeled inverted pendulum
balancing mobile robot", International Journal of Control, Automation and Systems 13(4), 2015, with slope and push.

The stop: bumpers at the body touch the ground at |b| = stop angle. They push along the ground's normal only, so their
force enters the second equation alone. The impact is inelastic: it takes q to zero, and with it m l cos b q / M goes
into v. Then b' = 0 as long as the second equation, left to itself, would take the body further.

What it leaves out: tyres that slip or lift off, rolling resistance, bumpers that rub.
"""

import math
from collections.abc import Sequence
from typing import Final

from segway_ecc.node.models.segway_parameters import SegwayParameters

_TOUCH: Final = 1.0e-9
"""Above the rounding error of a lean, rad."""
_IMPACT_STEP: Final = 0.001
"""How exactly the moment of an impact is found, s."""

BodyState = tuple[float, float, float, float, float, float, float, float]
"""v, q, w, their accelerations, pitch, and the slope of the ground."""
_Step = tuple[float, float, float, float, float, float]
"""v, q, w and pitch at its end, and what way and heading gained."""


class SegwayBody:
    """The body's equations of motion and their integration.

    Attributes:
        v, q, w: Forward speed (m/s), pitch rate (rad/s), yaw rate (rad/s).
        way, pitch, heading: Along the ground (m), against the vertical (rad), counter-clockwise (rad).
        dv, dq, dw: Their accelerations at the end of the last step, m/s2 and rad/s2; exact after `accelerate`.
        friction_rate: How fast the friction at rest stops what it acts on, 1/s; steps are to be short beside it.
    """

    def __init__(self, parameters: SegwayParameters) -> None:
        """Stand still and upright, unloaded, on level ground."""
        self._p = p = parameters
        self.v = self.q = self.w = self.way = self.pitch = self.heading = 0.0
        self.dv = self.dq = self.dw = 0.0
        self._push = 0.0
        self._rests = False
        self.per_radius = 1.0 / p.wheel_radius
        self.half_track = 0.5 * p.track
        self._per_coulomb_speed = 1.0 / p.coulomb_speed
        self._stop_angle = p.stop_angle
        self.load(0.0, 0.0)
        self.tilt(0.0)

    def load(self, payload: float, height: float) -> None:
        """Carry a point mass (kg) on the body's axis, `height` m above the axle."""
        p, rolling = self._p, self._p.wheel_mass + self._p.wheel_inertia / self._p.wheel_radius**2
        mass = p.body_mass + payload
        second = p.body_mass * p.body_height_of_centre**2 + payload * height**2
        self._weight_share = mass + 2.0 * p.wheel_mass
        self._mass = mass + 2.0 * rolling
        self._moment = p.body_mass * p.body_height_of_centre + payload * height
        self._centre = self._moment / mass
        self._pitch_inertia = second + p.body_pitch_inertia
        self._yaw_inertia = p.body_yaw_inertia + 2.0 * p.wheel_diameter_inertia + 2.0 * rolling * self.half_track**2
        self._yaw_excess = second + p.body_roll_inertia - p.body_yaw_inertia
        self._lever = self.half_track * self.per_radius
        self.friction_rate = self._friction_rate()
        self._plain = (
            *(self.per_radius, self._lever, p.viscous_friction, p.coulomb_friction, self._per_coulomb_speed),
            *(self._moment, self._moment * p.gravity, self._mass, self._pitch_inertia),
            *(self._yaw_inertia, self._yaw_excess),
        )

    def _friction_rate(self) -> float:
        """The larger one of rolling and turning, upright, where a torque between wheel and body moves them most."""
        p, mass, inertia, moment = self._p, self._mass, self._pitch_inertia, self._moment
        slope = 2.0 * (p.viscous_friction + p.coulomb_friction * self._per_coulomb_speed)
        rolling = (inertia * self.per_radius**2 + 2.0 * moment * self.per_radius + mass) / (mass * inertia - moment**2)
        return slope * max(rolling, self._lever**2 / self._yaw_inertia)

    def tilt(self, slope: float) -> None:
        """Have the ground rise ahead by `slope`, rad. The body keeps its pitch, unless the ground lifts it."""
        self.slope = slope
        self._sin_slope, self._cos_slope = math.sin(slope), math.cos(slope)

    def push(self, force: float) -> None:
        """Push at the centre of mass, N, horizontally and along the heading."""
        self._push = force

    def wheel_speeds(self) -> tuple[float, float]:
        """Speeds of the wheels against the body, rad/s."""
        rolling, steer = self.v * self.per_radius - self.q, self._lever * self.w
        return rolling - steer, rolling + steer

    def wheel_angles(self) -> tuple[float, float]:
        """Angles of the wheels against the body, rad: zero where the robot stood upright at the start."""
        rolling, steer = self.way * self.per_radius - self.pitch, self._lever * self.heading
        return rolling - steer, rolling + steer

    def wheel_accelerations(self) -> tuple[float, float]:
        """How fast `wheel_speeds` change, rad/s2."""
        rolling, steer = self.dv * self.per_radius - self.dq, self._lever * self.dw
        return rolling - steer, rolling + steer

    @property
    def state(self) -> BodyState:
        """What `measured_motion` follows from, as it is now."""
        return self.v, self.q, self.w, self.dv, self.dq, self.dw, self.pitch, self.slope

    def measured_motion(self, height: float, state: BodyState | None = None) -> Sequence[float]:
        """What a perfect IMU shows `height` m above the axle, in its axes: rates (rad/s), then specific forces (m/s2).

        Now, or in an earlier state. The axle's middle accelerates by dv ahead and v w to the left. The point on the
        body's axis at height h adds, in the axes of the body, h (dq - w^2 sin cos) ahead, h (dw sin + 2 w q cos) to the
        left, and -h (q^2 + w^2 sin^2) along the axis, with sin and cos of the lean; gravity's reaction adds
        -g sin(pitch) ahead and g cos(pitch) along the axis.
        """
        v, q, w, dv, dq, dw, pitch, slope = self.state if state is None else state
        gravity, lean = self._p.gravity, pitch + slope
        sin, cos = math.sin(lean), math.cos(lean)
        sideways = w * sin
        return (
            -sideways,
            q,
            w * cos,
            dv * cos + height * (dq - w * sideways * cos) - gravity * math.sin(pitch),
            v * w + height * (dw * sin + 2.0 * w * q * cos),
            dv * sin - height * (q * q + sideways * sideways) + gravity * math.cos(pitch),
        )

    def accelerations(  # noqa: PLR0913, PLR0917 - the state and both torques, five times a step: no room to pack them
        self, v: float, q: float, w: float, pitch: float, left: float, right: float
    ) -> tuple[float, float, float]:
        """The equations of motion at wheel torques (N m), friction taken off here."""
        per_radius, _, viscous, coulomb, per_speed, moment, weight, mass, inertia, yaw_inertia, excess = self._plain
        lean, half_track, push = pitch + self.slope, self.half_track, self._push
        sin, cos = math.sin(lean), math.cos(lean)
        steer = half_track * w
        speed_left, speed_right = (v - steer) * per_radius - q, (v + steer) * per_radius - q
        left -= viscous * speed_left + coulomb * math.tanh(speed_left * per_speed)
        right -= viscous * speed_right + coulomb * math.tanh(speed_right * per_speed)
        both, ml_sin, ml_cos = left + right, moment * sin, moment * cos
        excess_sin = excess * sin
        ahead = ml_sin * (q * q + w * w) + both * per_radius
        ahead += push * self._cos_slope - self._weight_share * self._p.gravity * self._sin_slope
        turning = excess_sin * cos * w * w + weight * math.sin(pitch) - both
        if push:
            turning += push * self._centre * math.cos(pitch)
        yaw = (right - left) * half_track * per_radius - w * (2.0 * excess_sin * cos * q + ml_sin * v)
        dw = yaw / (yaw_inertia + excess_sin * sin)
        if self._rests:
            return ahead / mass, 0.0, dw
        per_determinant = 1.0 / (mass * inertia - ml_cos * ml_cos)
        return (
            (inertia * ahead - ml_cos * turning) * per_determinant,
            (mass * turning - ml_cos * ahead) * per_determinant,
            dw,
        )

    def step(self, h: float, left: float, right: float) -> tuple[float, float]:
        """Advance by `h` s (classical Runge-Kutta) at constant torques (N m); returns what way and heading gain.

        A step in which the body reaches the stop is made again in short ones, so that it is reached when it is.
        """
        self._rests = self._is_held(left, right)
        before = self.v, self.q, self.w, self.pitch
        if self._rests or self.slope or self._push:
            moved = self._integrate(h, left, right)
        else:
            moved = self._integrate_plain(h, left, right)
        self.v, self.q, self.w, self.pitch, way, turn = moved
        if not -self._stop_angle < self.pitch + self.slope < self._stop_angle:
            if h > _IMPACT_STEP and not self._rests:
                self.v, self.q, self.w, self.pitch = before
                count = math.ceil(h / _IMPACT_STEP)
                ways, turns = zip(*(self.step(h / count, left, right) for _ in range(count)), strict=True)
                return sum(ways), sum(turns)
            self._hit_the_stop()
            self.accelerate(left, right)
        self.way += way
        self.heading += turn
        return way, turn

    def accelerate(self, left: float, right: float) -> None:
        """Have dv, dq and dw be those of the present state at these torques; a step leaves those of its last stage."""
        self.dv, self.dq, self.dw = self.accelerations(self.v, self.q, self.w, self.pitch, left, right)

    def _integrate(self, h: float, left: float, right: float) -> _Step:
        """One step of the classical Runge-Kutta method."""
        f = self.accelerations
        v, q, w, pitch, half = self.v, self.q, self.w, self.pitch, 0.5 * h
        a1, b1, c1 = f(v, q, w, pitch, left, right)
        v2, q2, w2 = v + half * a1, q + half * b1, w + half * c1
        a2, b2, c2 = f(v2, q2, w2, pitch + half * q, left, right)
        v3, q3, w3 = v + half * a2, q + half * b2, w + half * c2
        a3, b3, c3 = f(v3, q3, w3, pitch + half * q2, left, right)
        v4, q4, w4 = v + h * a3, q + h * b3, w + h * c3
        self.dv, self.dq, self.dw = a4, b4, c4 = f(v4, q4, w4, pitch + h * q3, left, right)
        sixth = h / 6.0
        return (
            v + sixth * (a1 + 2.0 * (a2 + a3) + a4),
            q + sixth * (b1 + 2.0 * (b2 + b3) + b4),
            w + sixth * (c1 + 2.0 * (c2 + c3) + c4),
            pitch + sixth * (q + 2.0 * (q2 + q3) + q4),
            sixth * (v + 2.0 * (v2 + v3) + v4),
            sixth * (w + 2.0 * (w2 + w3) + w4),
        )

    def _integrate_plain(self, h: float, left: float, right: float) -> _Step:
        """The same where nothing but gravity and the wheels acts, on level ground: `accelerations`, written out.

        This is where most of the time of a run in lock step goes.
        """
        per_radius, lever, viscous, coulomb, per_speed, moment, weight, mass, inertia, yaw_inertia, excess = self._plain
        tanh, product = math.tanh, mass * inertia
        v0, q0, w0, pitch0 = v, q, w, pitch = self.v, self.q, self.w, self.pitch
        way = turn = lean = dv = dq = dw = sum_v = sum_q = sum_w = 0.0
        half = 0.5 * h
        for ahead_by, share in ((half, 1.0), (half, 2.0), (h, 2.0), (0.0, 1.0)):
            sin, cos = math.sin(pitch), math.cos(pitch)
            rolling, steer = v * per_radius - q, lever * w
            speed_left, speed_right = rolling - steer, rolling + steer
            net_left = left - viscous * speed_left - coulomb * tanh(speed_left * per_speed)
            net_right = right - viscous * speed_right - coulomb * tanh(speed_right * per_speed)
            both, ml_sin, ml_cos = net_left + net_right, moment * sin, moment * cos
            excess_sin, square = excess * sin, w * w
            excess_sin_cos = excess_sin * cos
            ahead = ml_sin * (q * q + square) + both * per_radius
            turning = excess_sin_cos * square + weight * sin - both
            yaw = (net_right - net_left) * lever - w * (2.0 * excess_sin_cos * q + ml_sin * v)
            per_determinant = 1.0 / (product - ml_cos * ml_cos)
            dv = (inertia * ahead - ml_cos * turning) * per_determinant
            dq = (mass * turning - ml_cos * ahead) * per_determinant
            dw = yaw / (yaw_inertia + excess_sin * sin)
            way, turn, lean = way + share * v, turn + share * w, lean + share * q
            sum_v, sum_q, sum_w = sum_v + share * dv, sum_q + share * dq, sum_w + share * dw
            pitch = pitch0 + ahead_by * q
            v, q, w = v0 + ahead_by * dv, q0 + ahead_by * dq, w0 + ahead_by * dw
        self.dv, self.dq, self.dw, sixth = dv, dq, dw, h / 6.0
        v, q, w, pitch = v0 + sixth * sum_v, q0 + sixth * sum_q, w0 + sixth * sum_w, pitch0 + sixth * lean
        return v, q, w, pitch, sixth * way, sixth * turn

    def _is_held(self, left: float, right: float) -> bool:
        """Whether the body lies on a bumper and nothing lifts it off."""
        lean = self.pitch + self.slope
        if abs(lean) < self._stop_angle - _TOUCH or self.q:
            return False
        self._rests = False
        return self.accelerations(self.v, 0.0, self.w, self.pitch, left, right)[1] * lean >= 0.0

    def _hit_the_stop(self) -> None:
        """Stay at the stop; what turned the body further is lost."""
        lean = math.copysign(self._stop_angle, self.pitch + self.slope)
        self.pitch = lean - self.slope
        if self.q * lean > 0.0:
            self.v += self._moment * math.cos(lean) * self.q / self._mass
            self.q = 0.0
            self._rests = True
