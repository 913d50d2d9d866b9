# SPDX-License-Identifier: MIT
"""How uncertain the odometry is: covariances that grow with the way, with turning and with slip.

Dead reckoning adds up increments, each of which is turned by the heading that was reached: an error of the heading
carries on into the position (Siegwart, Nourbakhsh, "Introduction to Autonomous Mobile Robots", 2004, 5.2.4). What is
seen of slip adds to the standard deviations by as much as may have been slipped: the difference of two velocities, or
of two rates, beyond what they differ by where nothing slips, over the time in which it was seen.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from segway_ecc.node.cycle.interfaces import Report
from segway_ecc.node.cycle.signals import ODOMETRY_SIGNALS, joint_signals

UNKNOWN: Final = 1e6
"""The variance of what a robot on a floor does not measure: height, roll and pitch, and their rates."""
_WAY: Final = 1e-4
"""Variance of the position for each metre, m2/m: 1 cm after 1 m, 10 cm after 100 m."""
_TURN_PER_METRE: Final = 1e-4
"""Variance of the heading for each metre, rad2/m."""
_TURN_PER_RADIAN: Final = 4e-4
"""Variance of the heading for each radian, rad2/rad: 0.02 rad after 1 rad."""
_LEAST_VELOCITY: Final = 0.01
_LEAST_RATE: Final = 0.01
_SHARE: Final = 0.02
"""Of a velocity and of a rate: the standard deviation beside the least one, m/s and rad/s."""
_LEAST_SLIP: Final = 0.05
"""By how much wheels and odometry differ where nothing slips, m/s."""
_LEAST_YAW_SLIP: Final = 0.1
"""By how much odometry and gyro differ where nothing slips, rad/s: with its bias, and as the body leans."""
_LONGEST_STEP_S: Final = 0.1
"""Between two reports; what was slipped in a longer pause is not known."""
_LARGEST: Final = 1e12


class Pose(NamedTuple):
    """The covariance of x, y (m) and heading (rad)."""

    xx: float
    xy: float
    xh: float
    yy: float
    yh: float
    hh: float


class Twist(NamedTuple):
    """The variances of the velocities ahead and to the side, m2/s2, and of the yaw rate, rad2/s2."""

    ahead: float
    aside: float
    yaw: float


class OdometryUncertainty:
    """The covariances of a robot's odometry since its start.

    Attributes:
        pose: In the frame of the odometry, about the reported pose.
        twist: In the frame of the base.
    """

    def __init__(self, signals: Sequence[str], wheel_radius: float | None = None, *, leans: bool = False) -> None:
        """Follow the signals that a robot publishes.

        Args:
            signals: Those of `Report.values`.
            wheel_radius: m; None where it is not known.
            leans: Whether its body leans, and its encoders turn with the body: its model takes slip out of the
                odometry, which the wheels then show.
        """
        self.pose = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self.twist = Twist(_LEAST_VELOCITY**2, _LEAST_VELOCITY**2, _LEAST_RATE**2)
        places = {signal: place for place, signal in enumerate(signals)}
        self._odometry = [places[signal] for signal in ODOMETRY_SIGNALS if signal in places]
        self._gyro_z, gyro_y = places.get("imu.angular_velocity_z"), places.get("imu.angular_velocity_y")
        joints = joint_signals(signals)
        wheels = [places[signal] for signal in joints[len(joints) // 2 :] if signal in places]
        self._wheels = wheels if leans and wheel_radius is not None and gyro_y is not None else []
        self._gyro_y, self._radius = gyro_y or 0, wheel_radius or 0.0
        self._last: tuple[int, float, float, float] | None = None

    def update(self, report: Report) -> None:
        """Follow a report, once; one whose odometry is not finite is passed over."""
        values = report.values
        x, y, heading, velocity, rate = (values[place] for place in self._odometry)
        if not math.isfinite(x + y + heading + velocity + rate):
            return
        last, self._last = self._last, (report.stamp_ns, x, y, heading)
        if last is None or last[0] == report.stamp_ns:
            return
        slip, yaw_slip = self._slip(values, velocity), self._yaw_slip(values, rate)
        step_s = min(max((report.stamp_ns - last[0]) * 1e-9, 0.0), _LONGEST_STEP_S)
        self._move(x - last[1], y - last[2], heading - last[3])
        if slip or yaw_slip:
            self._add_slip(slip * step_s, yaw_slip * step_s, heading)
        ahead = _LEAST_VELOCITY + _SHARE * abs(velocity) + slip
        aside = _LEAST_VELOCITY + slip + abs(yaw_slip * self._radius)
        yaw = _LEAST_RATE + _SHARE * abs(rate) + yaw_slip
        self.twist = Twist(ahead * ahead, aside * aside, yaw * yaw)

    def _move(self, dx: float, dy: float, turn: float) -> None:
        xx, xy, xh, yy, yh, hh = self.pose
        way = math.hypot(dx, dy)
        spread = _WAY * way
        # Of the increment as the heading turns: (-dy, dx) for each radian.
        x_turned, y_turned = xh - dy * hh, yh + dx * hh
        xx, yy = xx - dy * (xh + x_turned) + spread, yy + dx * (yh + y_turned) + spread
        xy += dx * xh - dy * y_turned
        hh += _TURN_PER_METRE * way + _TURN_PER_RADIAN * abs(turn)
        if xx + yy + hh < _LARGEST:  # else a pose has leapt beyond all that means anything
            self.pose = Pose(xx, xy, x_turned, yy, y_turned, hh)

    def _add_slip(self, slipped: float, turned: float, heading: float) -> None:
        """Add what may have been slipped along the heading, m, and turned, rad, to the standard deviations."""
        xx, xy, xh, yy, yh, hh = self.pose
        along_x, along_y = math.cos(heading), math.sin(heading)
        along = max(xx * along_x**2 + 2.0 * xy * along_x * along_y + yy * along_y**2, 0.0)
        more = 2.0 * math.sqrt(along) * slipped + slipped * slipped
        self.pose = Pose(
            xx + more * along_x**2,
            xy + more * along_x * along_y,
            xh,
            yy + more * along_y**2,
            yh,
            hh + 2.0 * math.sqrt(hh) * turned + turned * turned,
        )

    def _slip(self, values: Sequence[float], velocity: float) -> float:
        """How much faster the wheels roll than the robot moves, or slower, m/s; 0 where that is not seen."""
        if not self._wheels:
            return 0.0
        rolled = sum(values[place] for place in self._wheels) / len(self._wheels) + values[self._gyro_y]
        return _beyond(self._radius * rolled - velocity, _LEAST_SLIP)

    def _yaw_slip(self, values: Sequence[float], rate: float) -> float:
        """How much faster the robot turns than its gyro measures, or slower, rad/s; 0 where that is not seen."""
        return 0.0 if self._gyro_z is None else _beyond(rate - values[self._gyro_z], _LEAST_YAW_SLIP)


def _beyond(difference: float, least: float) -> float:
    """What of a difference is more than the least; what is not finite shows nothing."""
    return max(abs(difference) - least, 0.0) if math.isfinite(difference) else 0.0
