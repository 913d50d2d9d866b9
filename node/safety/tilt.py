# SPDX-License-Identifier: MIT
"""How far the body leans, and whether it is still, from the IMU alone and independent of the robot's control model."""

from collections.abc import Sequence
from math import atan2, hypot, inf
from typing import Final

from segway_ecc.node.safety.check import Check, View, periods_in

GRAVITY: Final = 9.80665
"""Standard gravity, m/s2."""

_CORRECTION_S: Final = 2.0
"""Time constant of the correction by the accelerometer, s: 0.01 rad/s of gyro bias is then 0.02 rad of tilt."""

_GRAVITY_WITHIN: Final = 0.1
"""The accelerometer is believed while its magnitude is this near to gravity, as a fraction: else the body is pushed."""

_START_S: Final = 0.1
"""Of how many samples the estimate begins: a single one may be wrong, and would be drawn away only slowly."""
_LONGEST_GAP_S: Final = 0.1
"""How long the newest turn is taken to go on where no sample comes, s."""

Vector = tuple[float, float, float]
"""In the robot's axes: x forward, y left, z up."""


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
        self._first: list[Vector] = []
        self._begin_with = periods_in(_START_S, period_s)

    def update(self, gyro: Vector, accelerometer: Vector, periods: int) -> None:
        """Take a sample, so many periods after the last: angular velocity, rad/s, and specific force, m/s2.

        At rest the force is +g upward.
        """
        ax, ay, az = accelerometer
        felt = hypot(ax, ay, az)
        mx, my, mz = _unit(ax, ay, az, felt)
        trusted = abs(felt - GRAVITY) <= _GRAVITY_WITHIN * GRAVITY
        if self._up is None:
            if trusted:
                self._begin((mx, my, mz))
            return
        elapsed_s = periods * self._period_s
        (x, y, z), (p, q, r) = self._up, gyro  # turned with the body: d(up)/dt = up x rate
        x, y, z = x + (y * r - z * q) * elapsed_s, y + (z * p - x * r) * elapsed_s, z + (x * q - y * p) * elapsed_s
        gain = min(elapsed_s / _CORRECTION_S, 1.0) if trusted else 0.0
        x += gain * (mx - x)
        y += gain * (my - y)
        z += gain * (mz - z)
        self._up = _unit(x, y, z, hypot(x, y, z))

    def reset(self) -> None:
        """Begin anew with the next samples."""
        self._up = None
        self._first.clear()

    def _begin(self, up: Vector) -> None:
        """Begin with the middle one of the first samples, of each axis: some may be wrong by any amount."""
        self._first.append(up)
        if len(self._first) >= self._begin_with:
            x, y, z = (sorted(values)[len(values) // 2] for values in zip(*self._first, strict=True))
            self._up = _unit(x, y, z, hypot(x, y, z))

    @property
    def tilt(self) -> float | None:
        """Angle between the body's z axis and up, 0 to pi rad; None before there were enough samples."""
        if self._up is None:
            return None
        x, y, z = self._up
        return atan2(hypot(x, y), z)


class TiltWatch(Check):
    """Tilt and the rate of tilting, within limits; see `Check`."""

    def __init__(self, imu: Sequence[int], period_s: float, tilt_limit: float | None, rate_limit: float | None) -> None:
        """Watch the IMU whose angular velocities, then accelerations, are at these places; limits in rad and rad/s."""
        self.needs: tuple[int, ...] = tuple(imu)
        self.estimate = TiltEstimate(period_s)
        self._tilt_limit = inf if tilt_limit is None else tilt_limit
        self._rate_limit = inf if rate_limit is None else rate_limit
        self._longest_gap = periods_in(_LONGEST_GAP_S, period_s)
        self._missed = 0

    def look(self, view: View) -> str | None:
        """See `Check`."""
        periods = self._missed + view.periods
        if not view.has(self.needs):
            self._missed = periods
            if periods > self._longest_gap:
                self.estimate.reset()
            return None
        self._missed = 0
        gyro, accelerometer = imu_vectors(view.values, self.needs)
        self.estimate.update(gyro, accelerometer, periods)
        rate, tilt = hypot(gyro[0], gyro[1]), self.estimate.tilt or 0.0
        if not tilt <= self._tilt_limit:
            return f"the body leans {tilt:.2f} rad, beyond {self._tilt_limit:g} rad"
        if not rate <= self._rate_limit:
            return f"the body tilts at {rate:.2f} rad/s, beyond {self._rate_limit:g} rad/s"
        return None


class StillWatch:
    """For how many periods an IMU has been still."""

    def __init__(self, imu: Sequence[int], rate_limit: float, acceleration_limit: float) -> None:
        """Call still what turns no faster, rad/s, and whose acceleration is no further from gravity, m/s2.

        The IMU's values are at the same places as for `TiltWatch`.
        """
        self.periods = 0
        self._imu: tuple[int, ...] = tuple(imu)
        self._rate_limit = rate_limit
        self._acceleration_limit = acceleration_limit

    def look(self, view: View) -> None:
        """Take a sample; without one, begin anew."""
        if not view.has(self._imu):
            self.periods = 0
            return
        (gx, gy, gz), (ax, ay, az) = imu_vectors(view.values, self._imu)
        turns = hypot(gx, gy, gz) > self._rate_limit
        moves = abs(hypot(ax, ay, az) - GRAVITY) > self._acceleration_limit
        self.periods = 0 if turns or moves else self.periods + view.periods


def imu_vectors(values: Sequence[float], imu: tuple[int, ...]) -> tuple[Vector, Vector]:
    """Angular velocity and specific force of the IMU whose values are at these places, in this order."""
    gx, gy, gz, ax, ay, az = imu
    return (values[gx], values[gy], values[gz]), (values[ax], values[ay], values[az])


def _unit(x: float, y: float, z: float, length: float) -> Vector:
    """The vector of length one in the direction of one of `length`; upright where there is none, as in free fall."""
    return (x / length, y / length, z / length) if length > 0.0 else (0.0, 0.0, 1.0)
