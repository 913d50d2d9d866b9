# SPDX-License-Identifier: MIT
"""What the IMU measures, against gravity and the wheels: noise is no motion, and a gyro that is off shows in time."""

from collections.abc import Sequence
from math import atan2, copysign, cos, hypot, isfinite, nan, sin
from typing import Final

from segway_ecc.node.safety.check import Check, View, periods_in
from segway_ecc.node.safety.plausibility import MOVING
from segway_ecc.node.safety.settings import GravitySettings
from segway_ecc.node.safety.spin import SpinWatch
from segway_ecc.node.safety.tilt import GRAVITY

_GRAVITY_WITHIN: Final = 0.1
"""It begins with a sample whose magnitude is this near to gravity, as a fraction."""
_LONGEST_GAP_S: Final = 0.1
"""After a longer gap it begins anew, s."""
_MOST_LEARNT: Final = 0.25
"""A residual counts as a gyro's offset up to here, m/s: what lasts for a few samples is none."""
_SHOCK: Final = 0.5
"""A shock adds this much of the limit in one sample: what an IMU measures falsely for longer adds up."""
_SHOCKS_APART_S: Final = 0.5
"""A body strikes the floor once in this time, s; noise does not wait."""
_UPRIGHT: Final = 0.4
"""A body that leans further, rad, falls: what its wheels do as it strikes the floor is no lost floor."""
_LEAST_HELD: Final = 0.5 * GRAVITY
_MOST_HELD: Final = 2.0 * GRAVITY
"""A body that feels less, m/s2, falls freely; one that feels more was struck by the floor, and not lifted."""
_RESTS_S: Final = 0.5
"""A gyro that reads next to nothing for so long, of a body that rests, is not off, s: what was learnt is of a blow. For
so long it must be still before it arms, too; what a landing leaves shows up to 0.8 s after it."""


class GravityCheck(Check):
    """The IMU's velocity by its accelerometer, in the plane of pitch, against that by wheels and gyro; see `Check`.

    On level ground an IMU at a height h above the axle, which goes ahead at v, moves ahead at v + h rate cos(pitch) and
    up at -h rate sin(pitch). Both are also the integral of the specific force, turned upright by the pitch, without
    gravity. An observer with three equal poles (Luenberger, 1971, doi 10.1109/TAC.1971.1099826) estimates the velocity
    ahead, the pitch and the gyro's offset from the residual; the velocity up is that of a filter with the gain of the
    first. Standing up, pushes and landing are motions that both show: they leave no residual. Noise does, soon. A
    shock between two samples, as of a body that falls onto its stop, does too: the first that comes in one sample,
    and after which the body turns more slowly, is passed over, as a gap is.

    While a wheel spins that lost the floor, for the setting `spin_s` at most, it does not count (`SpinWatch`), and
    nothing is learnt.

    What a hard landing leaves in the observer would be taken for an offset for some seconds. So while it is, and the
    robot rests with a gyro that reads less than that, it begins anew after half a second.

    Attributes:
        is_credible: Whether the newest sample goes with those before; it does not where none does.
    """

    def __init__(
        self, wheels: tuple[int, int], imu: tuple[int, int, int], settings: GravitySettings, period_s: float
    ) -> None:
        """Compare the wheels' velocities with the gyro about y and the accelerations along x and z, at these places."""
        self.needs: tuple[int, ...] = (*wheels, *imu)
        self.is_credible = True
        self._left, self._right = wheels
        self._imu = self._gyro, self._x, self._z = imu
        self._radius, self._height = settings.wheel_radius, settings.imu_height
        self._most_velocity, self._most_offset = settings.velocity_m_s, settings.gyro_rad_s
        pole = 1.0 / settings.settle_s
        self._velocity_gain = 3.0 * pole
        self._pitch_gain = 3.0 * pole**2 / GRAVITY
        self._offset_gain = pole**3 / GRAVITY
        self._period_s = period_s
        self._longest_gap = periods_in(_LONGEST_GAP_S, period_s)
        self._shocks_apart = periods_in(_SHOCKS_APART_S, period_s)
        self._rests_for = periods_in(_RESTS_S, period_s)
        self._missed = self._calm = self._rests = 0
        self._far = 0.0
        self._spin = (
            None if settings.spin_s is None else SpinWatch(settings.spin_s, self._most_velocity / 3.0, period_s)
        )
        self._is_running = False
        self._pitch = self._rate = self._offset = self._ahead = self._up = 0.0

    def look(self, view: View) -> str | None:
        """See `Check`."""
        periods = self._missed + view.periods
        if not view.has(self.needs):
            self._missed = periods
            if view.has(self._imu):  # drives that measure nothing before they are on: the IMU is judged alone
                self.is_credible = self._is_heavy(view.values)
            return None
        is_late = self._missed > 0
        self._missed = 0
        values = view.values
        rate, x, z = values[self._gyro], values[self._x], values[self._z]
        left, right = self._radius * values[self._left], self._radius * values[self._right]
        if not self._is_running or periods > self._longest_gap:
            self._begin(values)
            return None
        elapsed_s = periods * self._period_s
        turned = rate - self._offset
        pitch = self._pitch + elapsed_s * (0.5 * (rate + self._rate) - self._offset)
        is_slower, self._rate = abs(rate) < abs(self._rate), rate
        cosine, sine = (cos(pitch), sin(pitch)) if isfinite(pitch) else (nan, nan)
        swing = self._height * turned
        rolls = self._radius * turned + swing * cosine
        shown_ahead = self._ahead + elapsed_s * (x * cosine + z * sine)
        wheels = self._by_wheels(view, left, right, shown_ahead - rolls, periods, is_upright=abs(pitch) < _UPRIGHT)
        lost = None if self._spin is None else self._spin.fault
        ahead = wheels + rolls
        up = -swing * sine
        shown_up = self._up + elapsed_s * (z * cosine - x * sine - GRAVITY)
        off, off_up = ahead - shown_ahead, up - shown_up
        far, most = hypot(off, off_up), self._most_velocity
        self._calm += periods
        is_shock = not far <= most and is_slower and self._calm > self._shocks_apart and far - self._far > _SHOCK * most
        if is_shock:
            self._calm = 0
        if is_shock or is_late or lost is not None:  # what happened meanwhile is not known
            self._pitch, self._ahead, self._up, self._far = pitch, ahead, up, 0.0
            return lost
        if not far <= most:
            self._is_running = self.is_credible = False
            return f"{self._suspect}: against gravity and the wheels it is off by {far:.2f} m/s, beyond {most:g} m/s"
        self._far = far
        if view.spins:  # nothing is learnt
            elapsed_s = 0.0
        gain = elapsed_s * self._velocity_gain
        self._ahead = shown_ahead + gain * off
        self._up = shown_up + gain * off_up
        self._pitch = pitch + elapsed_s * self._pitch_gain * off
        if abs(off) > _MOST_LEARNT:  # seldom: min and max in every cycle take longer
            off = copysign(_MOST_LEARNT, off)
        self._offset -= elapsed_s * self._offset_gain * off
        return self._judge_offset(values, periods)

    def _by_wheels(  # noqa: PLR0913 - what there is of a cycle
        self, view: View, left: float, right: float, shown: float, periods: int, *, is_upright: bool
    ) -> float:
        """How fast the wheels carry the axle ahead, m/s, by their treads; see `SpinWatch.look`."""
        if self._spin is None:
            return 0.5 * (left + right)
        is_held = _LEAST_HELD < hypot(view.values[self._x], view.values[self._z]) < _MOST_HELD
        balances, is_idle = view.balances and is_upright, view.is_idle
        axle = self._spin.look(left, right, shown, periods, balances=balances, is_held=is_held, is_idle=is_idle)
        view.spins = self._spin.is_on
        return axle

    @property
    def _suspect(self) -> str:
        """What is known where IMU and wheels do not agree: a wheel that lost the floor may be why."""
        if self._spin is not None and self._spin.was_on:
            return "a wheel spun as without a floor, and the IMU does not show how the robot moves since"
        return "the IMU does not measure how the robot moves"

    def _judge_offset(self, values: Sequence[float], periods: int) -> str | None:
        """What is wrong with the gyro's offset, so many periods after it was judged last."""
        offset = self._offset
        if abs(offset) <= self._most_offset:
            self._rests = 0
            return None
        self._rests = self._rests + periods if self._is_resting(values) else 0
        if self._rests >= self._rests_for:
            self._begin(values)
            return None
        return f"the IMU's gyro is off by {offset:.2f} rad/s about y, beyond {self._most_offset:g} rad/s"

    def _is_resting(self, values: Sequence[float]) -> bool:
        """Whether wheels and body rest, by a gyro that is not off."""
        return (
            self._is_heavy(values)
            and abs(values[self._gyro]) <= self._most_offset
            and abs(values[self._left]) <= MOVING
            and abs(values[self._right]) <= MOVING
        )

    def _is_heavy(self, values: Sequence[float]) -> bool:
        """Whether the specific force is of the size of gravity, as of a body at rest."""
        return abs(hypot(values[self._x], values[self._z]) - GRAVITY) <= _GRAVITY_WITHIN * GRAVITY

    def _begin(self, values: Sequence[float]) -> None:
        """Begin with a sample that may be one of a body at rest."""
        rate, x, z = values[self._gyro], values[self._x], values[self._z]
        left, right = self._radius * values[self._left], self._radius * values[self._right]
        if self._spin is not None:
            self._spin.begin()
        self.is_credible = self._is_running = self._is_heavy(values)
        self._pitch, self._rate, self._offset = atan2(-x, z), rate, 0.0
        self._calm = self._rests = 0
        swing = self._height * rate
        self._ahead = 0.5 * (left + right) + self._radius * rate + swing * cos(self._pitch)
        self._up = -swing * sin(self._pitch)
