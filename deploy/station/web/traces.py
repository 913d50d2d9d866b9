# SPDX-License-Identifier: MIT
"""What each robot reported over the last ten minutes, for plots of a page that was opened or loaded since. Pure."""

import math
from array import array
from collections.abc import Sequence
from typing import Final

import msgspec

from segway_ecc.deploy.station.views import FleetView, RobotView

KEPT_S: Final = 600.0
PERIOD_S: Final = 0.2
"""Pictures that come sooner after the last that was kept are left out."""
_ALMOST_S: Final = 0.01
_MOST_ROWS: Final = round(KEPT_S / PERIOD_S)
_LINES: Final = ("pitch", "linear_velocity", "linear_setpoint", "angular_velocity", "angular_setpoint")
_WIDTH: Final = 1 + len(_LINES)
_DECIMALS: Final = 4


class TraceView(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot reported, oldest first; None is what it did not, and all are None of a robot that was lost.

    Attributes:
        time_s: When, by the station's clock as in `FleetView`, s.
        pitch: Forward lean, rad.
        linear_velocity: m/s.
        linear_setpoint: m/s.
        angular_velocity: rad/s.
        angular_setpoint: rad/s.
    """

    time_s: Sequence[float]
    pitch: Sequence[float | None]
    linear_velocity: Sequence[float | None]
    linear_setpoint: Sequence[float | None]
    angular_velocity: Sequence[float | None]
    angular_setpoint: Sequence[float | None]


class Traces:
    """Of every robot in the picture."""

    def __init__(self) -> None:
        """Begin with none."""
        self._rows: dict[str, array[float]] = {}
        self._newest_s = -math.inf

    def add(self, view: FleetView) -> None:
        """Keep what a picture has, where it is due; a robot that is no longer in it is forgotten."""
        if view.time_s - self._newest_s < PERIOD_S - _ALMOST_S:
            return
        self._newest_s = view.time_s
        known, self._rows = self._rows, {}
        for robot in view.robots:
            rows = self._rows[robot.robot] = known.get(robot.robot) or array("d")
            rows.extend((view.time_s, *_values(robot)))
            if len(rows) > _MOST_ROWS * _WIDTH:
                del rows[:_WIDTH]

    def of(self, robot: str) -> TraceView:
        """What is kept of a robot; nothing of one that is not known."""
        rows = self._rows.get(robot, array("d"))
        lines = {name: _column(rows, place) for place, name in enumerate(_LINES, 1)}
        return TraceView(time_s=list(rows[::_WIDTH]), **lines)


def _values(robot: RobotView) -> list[float]:
    """The value of each line; no number stands for what is not reported."""
    values = [getattr(robot, name) if robot.is_alive else None for name in _LINES]
    return [math.nan if value is None else round(value, _DECIMALS) for value in values]


def _column(rows: "array[float]", place: int) -> list[float | None]:
    return [None if math.isnan(value) else value for value in rows[place::_WIDTH]]
