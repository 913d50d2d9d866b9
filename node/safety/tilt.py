"""How far the body leans, from the IMU alone and independent of the robot's control model."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from node.safety.check import View

GRAVITY: Final = 9.80665
"""Standard gravity, m/s2."""

_CORRECTION_S: Final = 2.0
"""Time constant of the correction by the accelerometer, s: 0.01 rad/s of gyro bias is then 0.02 rad of tilt."""

_GRAVITY_WITHIN: Final = 0.1
"""The accelerometer is believed while its magnitude is this near to gravity, as a fraction: else the body is pushed."""


class Vector(NamedTuple):
    """In the robot's axes: x forward, y left, z up."""

    x: float
    y: float
    z: float


_UPRIGHT: Final = Vector(0.0, 0.0, 1.0)


class TiltEstimate:
    """The direction of up, seen from the body: turned by the gyro, and drawn to the accelerometer.

    The complementary filter of Mahony, Hamel and Pflimlin (2008, doi 10.1109/TAC.2008.923738) on the direction of
    gravity alone, without its estimate of the bias. The gyro makes it as new as the newest sample; the accelerometer
    holds it in the long run.
    """

    def __init__(self, period_s: float) -> None:
        """Know nothing yet; `update` is called once per period, s."""
        self._period_s = period_s
        self._up: Vector | None = None

    def update(self, gyro: Sequence[float], accelerometer: Sequence[float], periods: int) -> None:
        """Take a sample.

        Args:
            gyro: Angular velocity, rad/s.
            accelerometer: Specific force, m/s2; +g upward at rest.
            periods: Passed since the last one.
        """
        measured = _unit(*accelerometer)
        if self._up is None:
            self._up = measured
            return
        elapsed_s = periods * self._period_s
        turned = _turn(self._up, Vector(*gyro), elapsed_s)
        trusted = abs(math.hypot(*accelerometer) - GRAVITY) <= _GRAVITY_WITHIN * GRAVITY
        gain = min(elapsed_s / _CORRECTION_S, 1.0) if trusted else 0.0
        self._up = _unit(*(u + gain * (m - u) for u, m in zip(turned, measured, strict=True)))

    def forget(self) -> None:
        """Begin anew with the next sample."""
        self._up = None

    @property
    def tilt(self) -> float | None:
        """Angle between the body's z axis and up, 0 to pi rad; None before the first sample."""
        if self._up is None:
            return None
        return math.atan2(math.hypot(self._up.x, self._up.y), self._up.z)


class TiltWatch:
    """Tilt and the rate of tilting, within limits; see `Check`."""

    def __init__(self, imu: Sequence[int], period_s: float, tilt_limit: float | None, rate_limit: float | None) -> None:
        """Watch the IMU whose angular velocities, then accelerations, are at these places; limits in rad and rad/s."""
        self.needs: tuple[int, ...] = tuple(imu)
        self.estimate = TiltEstimate(period_s)
        self._tilt_limit = math.inf if tilt_limit is None else tilt_limit
        self._rate_limit = math.inf if rate_limit is None else rate_limit

    def look(self, view: View) -> str | None:
        """See `Check`."""
        if not view.has(self.needs):
            self.estimate.forget()
            return None
        values = view.pick(self.needs)
        self.estimate.update(values[:3], values[3:], view.periods)
        rate, tilt = math.hypot(*values[:2]), self.estimate.tilt or 0.0
        if not tilt <= self._tilt_limit:
            return f"the body leans {tilt:.2f} rad, beyond {self._tilt_limit:g} rad"
        if not rate <= self._rate_limit:
            return f"the body tilts at {rate:.2f} rad/s, beyond {self._rate_limit:g} rad/s"
        return None


def _turn(up: Vector, rate: Vector, elapsed_s: float) -> Vector:
    """Up, seen from a body that turned: d(up)/dt = up x rate."""
    return Vector(
        up.x + (up.y * rate.z - up.z * rate.y) * elapsed_s,
        up.y + (up.z * rate.x - up.x * rate.z) * elapsed_s,
        up.z + (up.x * rate.y - up.y * rate.x) * elapsed_s,
    )


def _unit(x: float, y: float, z: float) -> Vector:
    """A vector of length one in that direction; upright where there is no direction, as in free fall."""
    length = math.hypot(x, y, z)
    return Vector(x / length, y / length, z / length) if length > 0.0 else _UPRIGHT
