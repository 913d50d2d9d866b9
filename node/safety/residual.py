# SPDX-License-Identifier: MIT
"""What a balancing robot's acceleration shows of it: payload, slope, friction and tyres, before they are a fault.

The momentum ahead of a body on two wheels (mass m of all that moves, with what turns as mass; moment n = body's mass
times the height of its centre; see `segway_ecc.hil.plants.segway_body`) at a small lean, with the torque T of both
wheels of radius r:

    T / r = m v' + n q' + F,        F = m g sin(slope) + friction

What is left of T / r without m v' + n q' and the friction that is known is laid to a payload at a height h, to the
slope and to more friction, M (v' + h q') + S + D sign(v), by least squares. All signals pass the same filter, of two
equal lags, which makes accelerations of velocities (state-variable filters: Young, "Parameter estimation for
continuous-time models - a survey", Automatica 17, 1981).

A tyre that is smaller than it should be shows in the IMU: its acceleration ahead is that of the wheels times k, the
radius as a share of what it should be. The specific force along x is v' + h q' - g sin(pitch); what is constant or slow
in it, and the unknown start of the pitch, are taken off by a washout s / (s + 1 / W).

A push is not learnt from: what is not explained of the force, beyond a limit, counts only once it lasts.
"""

from collections.abc import Sequence
from math import copysign
from typing import Final

from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.safety.check import View, periods_in
from segway_ecc.node.safety.deviations import CAUSES, UNITS, Deviations
from segway_ecc.node.safety.forgetting_fit import LineFit, PlaneFit
from segway_ecc.node.safety.settings import ResidualSettings
from segway_ecc.node.safety.tilt import GRAVITY

_LAG_S: Final = 0.05
"""Of each of the two lags of the filter, s."""
_WASHOUT_S: Final = 1.0
"""W, s."""
_SETTLES_S: Final = 0.3
"""After a gap or a push nothing is learnt for so long, s."""
_MEMORY_S: Final = 10.0
"""Time constant with which what was seen is forgotten, s."""
_SOLVED_EVERY_S: Final = 0.1
_ROLLING: Final = 0.5
"""The speed of a wheel from which it has all of its friction, rad/s: slower ones may be noise."""
_PAYLOAD_PRIOR: Final = 50.0
_RADIUS_PRIOR: Final = 100.0
"""Some part of what the memory holds when the robot drives, (m/s2)^2."""
_SLOPE_PRIOR: Final = 50.0
_FRICTION_PRIOR: Final = 500.0
_PUSHED: Final = 1.0
"""A force beyond what is explained, N, that is taken for a push or a kerb."""
_LONGEST_PUSH_S: Final = 1.5
"""Unless it lasts longer, s."""
SHOWN: Final = ("residual, N", *map("{}, {}".format, CAUSES, UNITS))
"""What `ResidualMonitor.values` has, in its order."""


class ResidualMonitor:
    """Compares the acceleration that a model predicts with what is measured; it warns, and is no reason for a fault.

    Attributes:
        estimates: What is estimated, in the order of `CAUSES`: payload, kg; slope, rad, positive where the ground rises
            ahead; Coulomb friction of each wheel beyond what is known, N m; radius of the tyres as a share of what it
            should be, less 1.
        deviations: Which of them are beyond their limits, as last reported.
        residual: The newest residual, N, filtered.
        warning: One that begins or ends in this cycle; None in nearly all.
    """

    def __init__(
        self,
        wheels: tuple[int, int],
        imu: tuple[int, int],
        commands: tuple[int, int],
        settings: ResidualSettings,
        period_s: float,
    ) -> None:
        """Compare the wheels' velocities with the gyro about y and the acceleration along x, at these places.

        The wheels' commands are at the places `commands` of what is sent.
        """
        s = settings
        self._needs: tuple[int, ...] = (*wheels, *imu)
        self._left, self._right = wheels
        self._gyro, self._x = imu
        self._left_sent, self._right_sent = commands
        self._radius, self._mass, self._moment, self._height = s.wheel_radius, s.mass, s.moment, s.imu_height
        self._coulomb, self._viscous = s.coulomb_friction, s.viscous_friction
        self._load_height = s.moment / s.mass if s.payload_height is None else s.payload_height
        self._per_volt = self._back_emf = 0.0
        if s.motor is not None:
            self._per_volt, self._back_emf = s.motor.constant / s.motor.resistance, s.motor.constant
        self._period_s = period_s
        self._gain = period_s / (_LAG_S + period_s)
        self._per_lag = 1.0 / _LAG_S
        self._washed = period_s / (_WASHOUT_S + period_s)
        self._settles = periods_in(_SETTLES_S, period_s)
        self._longest_push = periods_in(_LONGEST_PUSH_S, period_s)
        self._solves = periods_in(_SOLVED_EVERY_S, period_s)
        limits = (s.payload_kg, s.slope_rad, s.friction_n_m, s.radius_share)
        self.deviations = Deviations(limits, periods_in(s.for_s, _SOLVED_EVERY_S))
        kept = 1.0 - period_s / _MEMORY_S
        self._force_fit = PlaneFit(kept, (_PAYLOAD_PRIOR, _SLOPE_PRIOR, _FRICTION_PRIOR))
        self._radius_fit = LineFit(kept, _RADIUS_PRIOR)
        self._sent = [0.0] * (max(round(s.delay_s / period_s), 0) + 1)
        self._place = self._pushed = self._cycles = self._calm = 0
        self._waits = self._settles
        self._v1 = self._v2 = self._q1 = self._q2 = self._t1 = self._t2 = 0.0
        self._s1 = self._s2 = self._x1 = self._x2 = self._rate = self._felt = 0.0
        self._slow_z = self._slow_v = self._leant = 0.0
        self._load = self._force = self._drag = 0.0
        self.estimates = [0.0] * len(CAUSES)
        self.residual = 0.0
        self.warning: str | None = None

    @property
    def values(self) -> tuple[float, ...]:
        """The residual and the estimates, as they are published; see `SHOWN`."""
        return (self.residual, *self.estimates)

    def look(self, view: View) -> None:
        """Take a cycle, with the commands that left the robot, N m or V; see `warning`."""
        self.warning, sent = None, view.sent
        at = self._place = self._place + 1 if self._place + 1 < len(self._sent) else 0
        self._sent[at - 1] = sent[self._left_sent] + sent[self._right_sent]
        torque = self._sent[at]  # the oldest
        if view.periods != 1 or not view.has(self._needs):
            self._waits = self._settles
            return
        values = view.values
        # An encoder's velocity is later than what an IMU shows, by about half a cycle.
        rate, felt = values[self._gyro], values[self._x]
        self._rate, rate = rate, 0.5 * (self._rate + rate)
        self._felt, felt = felt, 0.5 * (self._felt + felt)
        ahead, swing = self._filter(torque, values[self._left], values[self._right], rate, felt)
        z = self._x2 - self._height * swing - ahead
        if not view.balances:
            self._waits = self._settles
        if self._waits:
            self._waits -= 1
            self._slow_z, self._slow_v, self._leant = z, ahead, 0.0  # the washouts begin here
            return
        washed = self._washed
        self._slow_z = slow_z = self._slow_z + washed * (z - self._slow_z)
        self._slow_v = slow_v = self._slow_v + washed * (ahead - self._slow_v)
        self._leant = leant = self._leant + self._period_s * self._q2 - washed * self._leant
        lift = ahead + self._load_height * swing
        if not self._is_pushed(self.residual - self._load * lift - self._force - self._drag * self._s2):
            self._force_fit.add(lift, self._s2, self.residual)
            self._radius_fit.add(ahead - slow_v, z - slow_z + GRAVITY * leant)
            self._cycles += 1
            if self._cycles >= self._solves:
                self._cycles = 0
                self._judge()

    def _filter(self, torque: float, left: float, right: float, rate: float, felt: float) -> tuple[float, float]:
        """Filter a cycle's signals; the filtered accelerations ahead, m/s2, and of the pitch, rad/s2."""
        turning = left + right
        if self._per_volt:
            torque = self._per_volt * (torque - self._back_emf * turning)
        rolling = 0.5 * (_sign(left) + _sign(right))
        friction = 2.0 * self._coulomb * rolling + self._viscous * turning
        gain = self._gain
        self._v1 = v1 = self._v1 + gain * (self._radius * (0.5 * turning + rate) - self._v1)
        self._v2 = v2 = self._v2 + gain * (v1 - self._v2)
        self._q1 = q1 = self._q1 + gain * (rate - self._q1)
        self._q2 = q2 = self._q2 + gain * (q1 - self._q2)
        self._t1 = t1 = self._t1 + gain * ((torque - friction) / self._radius - self._t1)
        self._t2 = t2 = self._t2 + gain * (t1 - self._t2)
        self._s1 = s1 = self._s1 + gain * (rolling - self._s1)
        self._s2 += gain * (s1 - self._s2)
        self._x1 = x1 = self._x1 + gain * (felt - self._x1)
        self._x2 += gain * (x1 - self._x2)
        ahead, swing = (v1 - v2) * self._per_lag, (q1 - q2) * self._per_lag
        self.residual = t2 - self._mass * ahead - self._moment * swing
        return ahead, swing

    def _is_pushed(self, unexplained: float) -> bool:
        """Whether a force, N, is that of a push, or one was there a moment ago."""
        if -_PUSHED < unexplained < _PUSHED:
            self._pushed = 0
            self._calm = max(self._calm - 1, 0)
            return self._calm > 0
        self._pushed += 1
        self._calm = self._settles
        return self._pushed < self._longest_push

    def _judge(self) -> None:
        """Solve for the estimates, and hold them against their limits."""
        self._load, self._force, self._drag = self._force_fit.solve()
        slope, friction = self._force / (self._mass * GRAVITY), 0.5 * self._drag * self._radius
        self.estimates = [self._load, slope, friction, self._radius_fit.solve()]
        self.warning = self.deviations.judge(self.estimates, is_radius_known=self._radius_fit.is_known)


def _sign(speed: float) -> float:
    """The direction in which a wheel turns, -1 to 1."""
    return speed / _ROLLING if -_ROLLING < speed < _ROLLING else copysign(1.0, speed)


def command_places(settings: ResidualSettings, commands: Sequence[str]) -> tuple[int, int]:
    """The places of the wheels' commands among those of a robot with a posture.

    Raises:
        ConfigurationError: They are not there; `commands` is empty where the robot has no posture.
    """
    kind = "torque" if settings.motor is None else "voltage"
    left, right = f"left.{kind}", f"right.{kind}"
    if left not in commands or right not in commands:
        raise ConfigurationError(
            f"safety.residual needs safety.posture and the commands {left} and {right}: with `motor` it is for wheels "
            "that take a voltage, without for a torque"
        )
    return list(commands).index(left), list(commands).index(right)
